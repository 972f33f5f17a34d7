"""Tables of `fogbank reproduce statues` and `staircase`: our figures beside those of the method's authors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import fogbank
import numpy as np
import pandas as pd
from fogbank.comparison.analysis import CURVE, levels, seconds_to
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


def tables(name: str, by_time: Comparison, by_records: Comparison, overheads: Sequence[Overhead]) -> list[str]:
    """Markdown."""
    lines = [f"## {name}", "", "Equal time: relative MSE (worst 0.1 % of the pixels left out)", ""]
    lines += _pivot(by_time.summary, "s")
    lines += ["", "Equal error: CPU seconds to a relative MSE", ""]
    lines += _times(by_time.time_to_error)
    lines += ["", "Equal records: relative MSE", ""]
    lines += _pivot(by_records.summary, "records")
    if _same(by_records.summary):
        lines += ["", "Both caches are the same here: their fog has no records."]
    lines += ["", "| figure | ours | the authors' |", "| --- | ---: | ---: |"]
    lines += [f"| cost of {item.what} | {item.share:+.0%} | {REPORTED_OVERHEAD:+.0%} |" for item in overheads]
    lines += _ellipsoids(by_records.summary)
    failed = pd.concat([by_time.table, by_records.table])
    failed = failed[~failed["status"].isin(["done"])]
    for (method, status, message), group in failed.groupby(["method", "status", "message"], sort=False):
        lines.append(f"\n{method}: {len(group)} pictures {status}: {message}")
    return [*lines, ""]


def _same(means: pd.DataFrame) -> bool:
    """Whether both caches made the same pictures."""
    errors = [means[means["method"] == name][CURVE].tolist() for name in ("radiance-cache", "radiance-cache-unaware")]
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


def _times(times: pd.DataFrame) -> list[str]:
    if times.empty:
        return ["No error was reached by more than its first picture."]
    methods = list(dict.fromkeys(times["method"]))
    lines = ["| relative MSE | " + " | ".join(methods) + " |", "| --- |" + " ---: |" * len(methods)]
    for level, rows in times.groupby("error", sort=False):
        cells = []
        for row in rows.to_dict("records"):
            known = row["seconds"] == row["seconds"] and row["seconds"] is not None
            cells.append(f"{'<= ' if row['at_most'] else ''}{row['seconds']:.2g}" if known else "not reached")
        lines.append(f"| {level:g} | " + " | ".join(cells) + " |")
    return lines


def _ellipsoids(means: pd.DataFrame) -> list[str]:
    """Records saved at equal error: the mean over the levels that both reach, and the range."""
    pairs = {
        extent: sorted(zip(rows["records"].tolist(), rows[CURVE].tolist(), strict=True))
        for extent, method in (("ellipsoids", "radiance-cache"), ("spheres", "radiance-cache:spheres"))
        if len(rows := means[means["method"] == method])
    }
    saved = []
    if len(pairs) == 2:
        both = means[means["method"].isin(["radiance-cache", "radiance-cache:spheres"])]
        for level in levels(both):
            ours, spheres = (seconds_to(pairs[extent], level) for extent in ("ellipsoids", "spheres"))
            first = any(points[0][1] <= level for points in pairs.values())
            if ours is not None and spheres is not None and not first:
                saved.append(1.0 - ours / spheres)
    text = "no common error" if not saved else f"{np.mean(saved):.0%} ({min(saved):.0%} to {max(saved):.0%})"
    return [f"| records that ellipsoids save against spheres at equal error | {text} | {REPORTED_ELLIPSOIDS:.0%} |"]
