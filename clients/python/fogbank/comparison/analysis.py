"""What the runs of a comparison say: means over seeds, cost of an error, who wins where."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pandas as pd

from fogbank.comparison.image_error import read, split
from fogbank.comparison.references import Reference
from fogbank.comparison.runs import Run

Cost: TypeAlias = Literal["cpu_seconds", "wall_seconds", "records"]
"""What pictures cost; columns of `summary`."""

CURVE = "trimmed"
"""The error that curves and times are of: relative MSE without the worst 0.1 % of the pixels."""
_MOST_LEVELS = 6
_STEPS = (1.0, 2.0, 5.0)

COLUMNS = (
    *("method", "budget", "seed", "status", "message"),
    *("wall_seconds", "cpu_seconds", "denoise_seconds", "startup_seconds", "load_seconds", "warm_up_seconds"),
    *("samples_per_pixel", "rays", "records", "peak_bytes"),
    *("mse", "relative_mse", "trimmed", "smape", "flip", "soft", "median", "percentile_99"),
)
"""Of results.csv; see `runs.Run`, `worker.Started`, `worker.Rendered` and `image_error.ImageError`."""


def table(runs: Sequence[Run]) -> pd.DataFrame:
    """A row for each run, failed ones too; columns COLUMNS."""
    rows = []
    for run in runs:
        fields = {"method": run.method, "budget": run.budget, "seed": run.seed, "status": run.status}
        fields |= {"message": run.message} | run.figures | run.errors
        rows.append([fields.get(name) for name in COLUMNS])
    return pd.DataFrame(rows, columns=list(COLUMNS))


def summary(results: pd.DataFrame) -> pd.DataFrame:
    """A row for each method and budget that has a picture: means over the seeds, least and greatest error."""
    done = results[results["status"] == "done"]
    numbers = list(COLUMNS[COLUMNS.index("wall_seconds") :])
    done = done.astype(dict.fromkeys(numbers, float))
    grouped = done.groupby(["method", "budget"], sort=False)
    means = grouped[numbers].mean()
    means["seeds"] = grouped.size()
    means["least"] = grouped[CURVE].min()
    means["greatest"] = grouped[CURVE].max()
    means = means.reset_index()
    order = {method: number for number, method in enumerate(dict.fromkeys(results["method"]))}
    return means.sort_values(
        ["method", "budget"], key=lambda column: column.map(order) if column.name == "method" else column
    ).reset_index(drop=True)


def bias_and_variance(images: Mapping[tuple[str, float, int], Path], reference: Reference) -> pd.DataFrame:
    """Bias and variance of each method and budget that has two seeds or more, see `image_error.BiasVariance`."""
    groups: dict[tuple[str, float], list[Path]] = {}
    for (method, budget, _), path in images.items():
        groups.setdefault((method, budget), []).append(path)
    rows = []
    for (method, budget), paths in groups.items():
        if len(paths) < 2:
            continue
        found = split([read(path) for path in paths], reference.half_a, reference.half_b)
        rows.append((method, budget, len(paths), found.bias_squared, found.variance))
    return pd.DataFrame(rows, columns=["method", "budget", "seeds", "bias_squared", "variance"])


def cost_at(points: Sequence[tuple[float, float]], error: float) -> float | None:
    """Cost of an error, between measured points (cost, error) by a power law.

    Returns the first point's cost when it is good enough already, None when no point is. Extrapolates nothing.
    """
    before: tuple[float, float] | None = None
    for cost, reached in sorted(points):
        if reached <= error:
            # A picture of no records has no place on logarithmic axes.
            if before is None or before[0] <= 0 or reached <= 0 or before[1] <= 0:
                return float(cost)
            slope = math.log(cost / before[0]) / math.log(reached / before[1])
            return float(before[0] * (error / before[1]) ** slope)
        before = (cost, reached)
    return None


def curve(means: pd.DataFrame, method: str, cost: Cost) -> list[tuple[float, float]]:
    """Points (cost, error) of a method in the order of the cost; none where it has no such cost."""
    rows = means[(means["method"] == method) & means[cost].notna()]
    return sorted(zip(rows[cost].tolist(), rows[CURVE].tolist(), strict=True))


def levels(means: pd.DataFrame) -> list[float]:
    """Errors worth a row: 1, 2, 5 times powers of ten that some method reaches and some doesn't begin below."""
    errors = means[CURVE][means[CURVE] > 0]
    if errors.empty:
        return []
    least, greatest = float(errors.min()), float(errors.max())
    powers = range(math.floor(math.log10(least)), math.ceil(math.log10(greatest)) + 1)
    # Through its decimal form: 2 * 10 ** -3 is not 0.002.
    steps = [float(f"{step:g}e{power}") for power in powers for step in _STEPS]
    inside = [level for level in steps if least <= level < greatest]
    if len(inside) > _MOST_LEVELS:
        chosen = np.linspace(0, len(inside) - 1, _MOST_LEVELS).round().astype(int)
        inside = [inside[index] for index in chosen]
    return sorted(inside, reverse=True)


def cost_to_error(means: pd.DataFrame, methods: Sequence[str], base: str, cost: Cost) -> pd.DataFrame:
    """Rows (error, method, cost, at_most, ratio): what each of `levels` costs.

    `at_most` marks a method whose first picture was better already. `ratio` is the method's cost by that of `base`:
    above 1 it is dearer. Missing numbers: never got there.
    """
    rows = []
    for level in levels(means):
        reference = cost_at(curve(means, base, cost), level)
        for method in methods:
            points = curve(means, method, cost)
            paid = cost_at(points, level)
            ratio = paid / reference if paid is not None and reference else None
            rows.append((level, method, paid, bool(points) and points[0][1] <= level, ratio))
    return pd.DataFrame(rows, columns=["error", "method", "cost", "at_most", "ratio"])


def choose_base(methods: Sequence[str]) -> str:
    """Whom the others are compared with: the cache, else the first."""
    return "radiance-cache" if "radiance-cache" in methods else methods[0]


def verdicts(means: pd.DataFrame, costs: pd.DataFrame, methods: Sequence[str], base: str) -> list[str]:
    """Sentences that say where `base` wins and where it loses, against each method."""
    sentences = []
    ours = means[means["method"] == base].set_index("budget")[CURVE]
    for method in methods:
        if method == base:
            continue
        theirs = means[means["method"] == method].set_index("budget")[CURVE]
        ratios = (theirs / ours).dropna()
        ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
        if ratios.empty:
            continue
        lost = [f"{budget:g}" for budget in ratios.index[ratios < 1.0]]
        won = [f"{budget:g}" for budget in ratios.index[ratios > 1.0]]
        parts = []
        if won:
            parts.append(f"{base} has the smaller error at budget {', '.join(won)}")
        if lost:
            parts.append(f"{method} has the smaller error at budget {', '.join(lost)}")
        between = f"error of {method} / error of {base} between {ratios.min():.2g} and {ratios.max():.2g}"
        reached = costs[(costs["method"] == method) & costs["cost"].notna()]["error"]
        mine = costs[(costs["method"] == base) & costs["cost"].notna()]["error"]
        only = sorted(set(reached) - set(mine))
        if only:
            parts.append(f"only {method} reached {', '.join(f'{level:g}' for level in only)}")
        sentences.append(f"Against {method}: {'; '.join(parts) or 'equal'}; {between}.")
    return sentences
