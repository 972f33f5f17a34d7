"""Plots of the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeAlias

import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fogbank.comparison.analysis import CURVE, Clock

Axis: TypeAlias = Clock | Literal["records"]

_LABELS: dict[Axis, str] = {
    "cpu_seconds": "CPU time, s (all threads, without start-up, loading, compilation)",
    "wall_seconds": "wall-clock time, s (without start-up, loading, compilation)",
    "records": "records",
}
_MARKERS = "osD^vPX*"


def error_plot(
    means: pd.DataFrame,
    methods: Sequence[str],
    axis: Axis,
    path: Path,
    title: str,
    *,
    floor: float | None = None,
) -> None:
    """Error against time or records, log-log, with a band from the best to the worst seed.

    Args:
        means: of `analysis.summary`.
        methods: in the order of the legend.
        axis: column of the horizontal axis.
        path: PNG to write.
        title: above it.
        floor: relative MSE of the reference's own noise, drawn as a line.
    """
    figure = Figure(figsize=(7.6, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for number, method in enumerate(methods):
        rows = means[(means["method"] == method) & (means[CURVE] > 0)].sort_values(axis)
        if rows.empty:
            continue
        (line,) = axes.plot(
            rows[axis], rows[CURVE], marker=_MARKERS[number % len(_MARKERS)], markersize=5, label=method
        )
        least = rows["least"].clip(lower=rows[CURVE].min() / 10)
        axes.fill_between(rows[axis], least, rows["greatest"], color=line.get_color(), alpha=0.18, linewidth=0)
    if floor is not None:
        axes.axhline(floor, color="0.5", linestyle=":", linewidth=1, label="noise of the reference, which cancels")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(_LABELS[axis])
    axes.set_ylabel("relative MSE, worst 0.1 % of the pixels left out")
    axes.set_title(title, fontsize=11)
    axes.grid(which="both", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=120)
