"""Tables of `fogbank reproduce statues` and `staircase`: our figures beside those of the method's authors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import fogbank
import numpy as np
import pandas as pd
from fogbank.comparison.analysis import CURVE, Cost, cost_at, curve, levels
from fogbank.comparison.comparison import Comparison

REPORTED_OVERHEAD = 0.09
"""Of derivatives that see occlusion on the making of records, as the authors reported; method.md section 15."""
REPORTED_ELLIPSOIDS = 0.30
"""Cost that ellipsoids save against spheres, as the authors reported; method.md section 15."""

_POINTS = 5
_SAMPLES = 4096
"""Directions of a record: long enough to measure, short enough to be left alone by what else the machine does."""
_MOST_TRIES = 64
_ROUNDS = 8


@dataclass(frozen=True)
class Overhead:
    """What derivatives cost on top of the value."""

    what: str
    """Which derivatives."""

    share: float
    """Time over that of the value alone, less 1."""


def measure_overhead(scene: fogbank.Scene) -> list[Overhead]:
    """Of gradient and Hessian at points in the fog, by one thread's time; of each point the fastest round counts."""
    points = _points_in_fog(scene)
    if len(points) == 0:
        return []
    variants: dict[str, dict[str, Any]] = {
        "value": {"derivatives": "value"},
        "gradient and Hessian, same rays": {"derivatives": "hessian", "bisect": False},
        "gradient and Hessian, silhouettes bisected": {"derivatives": "hessian", "bisect": True},
    }
    least = {name: np.full(len(points), np.inf) for name in variants}
    for _ in range(_ROUNDS):
        for name, options in variants.items():
            found = scene.probe(points, samples=_SAMPLES, repeats=1, **options)
            least[name] = np.minimum(least[name], found.seconds)
    value = least.pop("value").sum()
    return [Overhead(name, float(seconds.sum() / value) - 1.0) for name, seconds in least.items()]


def _points_in_fog(scene: fogbank.Scene) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Random ones, the same every time."""
    random = np.random.default_rng(1)
    directions = random.normal(size=(_MOST_TRIES, 3))
    directions *= (random.random((_MOST_TRIES, 1)) ** (1 / 3)) / np.linalg.norm(directions, axis=1, keepdims=True)
    tries = np.asarray(scene.bounds.center) + 0.5 * scene.bounds.radius * directions
    found = scene.probe(tries, derivatives="value", samples=16, repeats=1)
    # Where no light comes there is nothing to derive: inside walls.
    return tries[(np.asarray(found.medium) >= 0) & (np.asarray(found.luminance) > 0)][:_POINTS]


@dataclass(frozen=True)
class Caches:
    """Methods of the comparison at equal records."""

    aware: str
    spheres: str
    """The same with spheres."""
    unaware: str


def tables(
    name: str, by_time: Comparison, by_records: Comparison, caches: Caches, overheads: Sequence[Overhead]
) -> list[str]:
    """Markdown."""
    lines = [f"## {name}", "", "Equal time: relative MSE (worst 0.1 % of the pixels left out)", ""]
    lines += _pivot(by_time.summary, "s")
    lines += ["", "Equal error: CPU seconds to a relative MSE", ""]
    lines += _costs(by_time.time_to_error)
    lines += ["", "Equal records: relative MSE, all light that can come from records taken from them", ""]
    lines += _pivot(by_records.summary, "records")
    lines += ["", "Equal error: records to a relative MSE", ""]
    lines += _costs(by_records.records_to_error)
    lines += ["", "Equal error: CPU seconds to a relative MSE, of the same pictures", ""]
    lines += _costs(by_records.time_to_error)
    if _same(by_records.summary, caches):
        lines += ["", "Both caches are the same here: their fog has no records."]
    lines += ["", "| figure | ours | the authors' |", "| --- | ---: | ---: |"]
    lines += [f"| cost of {item.what} | {item.share:+.0%} | {REPORTED_OVERHEAD:+.0%} |" for item in overheads]
    lines += _ellipsoids(by_records.summary, caches) + _aware(by_records.summary, caches)
    failed = pd.concat([by_time.table, by_records.table])
    failed = failed[~failed["status"].isin(["done"])]
    for (method, status, message), group in failed.groupby(["method", "status", "message"], sort=False):
        lines.append(f"\n{method}: {len(group)} pictures {status}: {message}")
    return [*lines, ""]


def _same(means: pd.DataFrame, caches: Caches) -> bool:
    """Whether both caches made the same pictures."""
    errors = [means[means["method"] == name][CURVE].tolist() for name in (caches.aware, caches.unaware)]
    return bool(errors[0]) and errors[0] == errors[1]


def _pivot(means: pd.DataFrame, unit: str) -> list[str]:
    budgets = sorted(means["budget"].unique())
    lines = ["| method | " + " | ".join(f"{budget:g} {unit}" for budget in budgets) + " |"]
    lines.append("| --- |" + " ---: |" * len(budgets))
    for method, rows in means.groupby("method", sort=False):
        errors = rows.set_index("budget")[CURVE].to_dict()
        cells = [f"{errors[budget]:.2g}" if budget in errors else "-" for budget in budgets]
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return lines


def _costs(costs: pd.DataFrame) -> list[str]:
    if costs.empty:
        return ["No error was reached by more than its first picture."]
    methods = list(dict.fromkeys(costs["method"]))
    lines = ["| relative MSE | " + " | ".join(methods) + " |", "| ---: |" + " ---: |" * len(methods)]
    for level, rows in costs.groupby("error", sort=False):
        cells = []
        for row in rows.to_dict("records"):
            known = row["cost"] == row["cost"] and row["cost"] is not None
            cells.append(f"{'≤ ' if row['at_most'] else ''}{_number(row['cost'])}" if known else "not reached")
        lines.append(f"| {level:g} | " + " | ".join(cells) + " |")
    return lines


def _number(cost: float) -> str:
    """Two digits, or all of those before the point."""
    return f"{cost:.2g}" if cost < 10 else f"{cost:.0f}"


@dataclass(frozen=True)
class Ratios:
    """Cost of one method by that of another at equal errors."""

    exact: list[float]
    """At levels that both reach, with neither's first picture."""

    at_least: float | None
    """Greatest lower bound by the other levels: those that the other has with its first picture, or the one not even
    with its last."""

    at_most: float | None
    """Least upper bound by the other levels."""


def _ratios(means: pd.DataFrame, one: str, other: str, cost: Cost) -> Ratios:
    """Of `one` by `other`."""
    upper, lower = ([point for point in curve(means, name, cost) if point[0] > 0] for name in (one, other))
    exact, at_least, at_most = [], [], []
    if upper and lower:
        for level in levels(means[means["method"].isin([one, other])]):
            dividend, divisor = cost_at(upper, level), cost_at(lower, level)
            dividend_first, divisor_first = upper[0][1] <= level, lower[0][1] <= level
            if dividend is None and divisor is not None:
                at_least.append(upper[-1][0] / divisor)
            elif dividend is not None and divisor is None:
                at_most.append(dividend / lower[-1][0])
            elif dividend is not None and divisor is not None:
                if divisor_first and not dividend_first:
                    at_least.append(dividend / divisor)
                elif dividend_first and not divisor_first:
                    at_most.append(dividend / divisor)
                elif not dividend_first:
                    exact.append(dividend / divisor)
    return Ratios(exact, max(at_least, default=None), min(at_most, default=None))


def _ellipsoids(means: pd.DataFrame, caches: Caches) -> list[str]:
    """Share of records and time that ellipsoids save at equal error: its mean over the levels, and the range."""
    kinds: tuple[tuple[Cost, str], ...] = (("records", "records"), ("cpu_seconds", "CPU time"))
    return [
        f"| {what} that ellipsoids save against spheres at equal error |"
        f" {_said(_ratios(means, caches.spheres, caches.aware, kind), _saved)} |"
        f" {REPORTED_ELLIPSOIDS:.0%} |"
        for kind, what in kinds
    ]


def _aware(means: pd.DataFrame, caches: Caches) -> list[str]:
    """What the cache that doesn't see occlusion needs by what the other one does, at equal error."""
    kinds: tuple[tuple[Cost, str], ...] = (("records", "records"), ("cpu_seconds", "CPU time"))
    return [
        f"| {what} of the unaware cache by that of the aware one at equal error |"
        f" {_said(_ratios(means, caches.unaware, caches.aware, kind), _times)} | - |"
        for kind, what in kinds
    ]


def _saved(ratio: float) -> str:
    return f"{1.0 - 1.0 / ratio:.0%}"


def _times(ratio: float) -> str:
    return f"{ratio:.2g}x" if ratio < 10 else f"{ratio:.0f}x"


def _said(ratios: Ratios, text: Callable[[float], str]) -> str:
    """The geometric mean and the range; bounds where there is no exact ratio."""
    if ratios.exact:
        mean = float(np.exp(np.mean(np.log(ratios.exact))))
        return f"{text(mean)} ({text(min(ratios.exact))} to {text(max(ratios.exact))})"
    bounds = [
        f"{word} {text(bound)}"
        for word, bound in (("over", ratios.at_least), ("under", ratios.at_most))
        if bound is not None
    ]
    return " / ".join(bounds) or "no common error"
