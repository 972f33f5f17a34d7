"""Plots of errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from fogbank.comparison.analysis import CURVE, Cost

_LABELS: dict[Cost, str] = {
    "cpu_seconds": "CPU time, s (all threads, without start-up, loading, compilation)",
    "wall_seconds": "wall-clock time, s (without start-up, loading, compilation)",
    "records": "records",
}
_ERROR_LABEL = "relative MSE, worst 0.1 % of the pixels left out"
_MARKERS = "osD^vPX*"
_COLUMNS = 3


def error_plot(
    means: pd.DataFrame,
    methods: Sequence[str],
    axis: Cost,
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
        floor: least error that the reference can tell, drawn as a line.
    """
    figure = Figure(figsize=(7.6, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _draw(axes, means, methods, axis)
    if floor is not None:
        axes.axhline(floor, color="0.5", linestyle=":", linewidth=1, label="least error that the reference can tell")
    axes.set_xlabel(_LABELS[axis])
    axes.set_ylabel(_ERROR_LABEL)
    axes.set_title(title, fontsize=11)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=120)


def error_plots(means: Mapping[str, pd.DataFrame], path: Path) -> None:
    """A panel of error against CPU time for each scene, as PNG; `means` of `analysis.summary` by scene."""
    columns = min(_COLUMNS, max(1, len(means)))
    rows = max(1, math.ceil(len(means) / columns))
    figure = Figure(figsize=(3.7 * columns + 0.4, 3.0 * rows + 0.8), layout="constrained")
    FigureCanvasAgg(figure)
    # The same method has the same colour in every panel.
    methods = list(dict.fromkeys(method for found in means.values() for method in found["method"]))
    for number, (scene, found) in enumerate(means.items()):
        axes = figure.add_subplot(rows, columns, number + 1)
        _draw(axes, found, methods, "cpu_seconds")
        axes.set_title(scene, fontsize=11)
        if number + columns >= len(means):
            axes.set_xlabel("CPU time, s")
        if number == 0:
            names = axes.get_legend_handles_labels()
            figure.legend(*names, loc="outside lower center", ncols=2 * columns, frameon=False, fontsize=9)
    figure.supylabel(_ERROR_LABEL, fontsize=10)
    figure.savefig(path, dpi=100)


def _draw(axes: Axes, means: pd.DataFrame, methods: Sequence[str], axis: Cost) -> None:
    for number, method in enumerate(methods):
        rows = means[(means["method"] == method) & (means[CURVE] > 0)].sort_values(axis)
        colour = f"C{number}"
        axes.plot(
            rows[axis],
            rows[CURVE],
            marker=_MARKERS[number % len(_MARKERS)],
            markersize=5,
            color=colour,
            label=method,
        )
        if not rows.empty:
            least = rows["least"].clip(lower=rows[CURVE].min() / 10)
            axes.fill_between(rows[axis], least, rows["greatest"], color=colour, alpha=0.18, linewidth=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for ruler in (axes.xaxis, axes.yaxis):
        # Numbers at 1, 2, 5: a comparison often spans less than two decades.
        ruler.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ruler.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(which="both", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
