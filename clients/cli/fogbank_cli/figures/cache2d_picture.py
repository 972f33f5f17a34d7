"""The picture of two-dimensional caches: radiance, relative error and extents at similar record counts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from fogbank.flatland import FlatlandScene
from fogbank.flatland_cache import FlatlandCache
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from fogbank_cli.figures.cache2d_errors import AWARE, CORRECTED, RIVAL, UNAWARE, VARIANTS, Picture, Run
from fogbank_cli.figures.gradient_errors import box_of

# Pictures are compared at the run nearest to so many records.
_RECORDS = 1000
_PICTURED = (RIVAL, UNAWARE, AWARE, CORRECTED)
_ERROR_RANGE = 0.3
# Share of the mean radiance below which errors are relative to that.
_FLOOR = 0.05
_PANEL_INCHES = 3.2
_COLORS = ("#d62728", "#ff7f0e", "#9ecae1", "#1f77b4", "#2ca02c", "#98df8a", "#000000")


def draw(scene: FlatlandScene, picture: Picture, runs: Sequence[Run], path: Path) -> None:
    """Writes the figure."""
    shown = [
        min((run for run in runs if run.variant == variant), key=lambda run: abs(np.log(run.row.records / _RECORDS)))
        for variant in _PICTURED
    ]
    low, high = box_of(scene)
    extent = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    with mpl.rc_context({"font.size": 9, "image.origin": "lower", "image.interpolation": "nearest"}):
        width, height = _PANEL_INCHES, _PANEL_INCHES * (extent[3] - extent[2]) / (extent[1] - extent[0])
        figure = Figure(figsize=((len(shown) + 1) * width, 3 * height + 0.9), layout="constrained")
        panels = figure.subplots(3, len(shown) + 1)
        white = float(np.percentile(picture.exact, 90)) or 1.0

        def image(panel: Axes, values: NDArray[np.float64], colors: str, smallest: float, largest: float) -> None:
            side = picture.resolution
            panel.imshow(values.reshape(side, side), extent=extent, cmap=colors, vmin=smallest, vmax=largest)
            _add_segments(panel, scene)
            panel.set(xticks=[], yticks=[], xlim=extent[:2], ylim=extent[2:])

        image(panels[0, 0], picture.exact, "gray", 0, white)
        panels[0, 0].set_title("exact")
        _plot_errors(panels[1, 0], runs)
        panels[2, 0].axis("off")
        handles, labels = panels[1, 0].get_legend_handles_labels()
        panels[2, 0].legend(handles, labels, loc="upper left", frameon=False)
        floor = picture.exact + _FLOOR * picture.exact.mean()
        for column, run in enumerate(shown, start=1):
            image(panels[0, column], run.radiance, "gray", 0, white)
            panels[0, column].set_title(
                f"{run.row.method}\n{run.row.records} records, penumbra RMSE {run.row.penumbra_rmse:.3f}"
            )
            error = (run.radiance - picture.exact) / np.where(floor > 0, floor, 1)
            image(panels[1, column], error, "RdBu_r", -_ERROR_RANGE, _ERROR_RANGE)
            panels[1, column].set_title(f"relative error, within {_ERROR_RANGE:.0%}")
            image(panels[2, column], picture.exact, "gray", 0, white)
            _add_extents(panels[2, column], run.cache)
            panels[2, column].set_title("extents of the records")
        figure.savefig(path, dpi=110)


def _plot_errors(panel: Axes, runs: Sequence[Run]) -> None:
    for variant, color in zip(VARIANTS, _COLORS, strict=True):
        rows = [run.row for run in runs if run.variant == variant]
        panel.loglog(
            [row.records for row in rows],
            # A logarithmic scale has no place for 0.
            [max(row.penumbra_rmse, 1e-9) for row in rows],
            marker="o",
            markersize=3,
            color=color,
            linestyle=":" if variant.method == "exact" else "-",
            label=variant.label,
        )
    panel.set(xlabel="records", ylabel="penumbra RMSE / mean")
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.grid(visible=True, which="both", alpha=0.25)


def _add_extents(panel: Axes, cache: FlatlandCache) -> None:
    panel.add_collection(
        EllipseCollection(
            2 * cache.semi_axes[:, 0],
            2 * cache.semi_axes[:, 1],
            np.degrees(np.arctan2(cache.axis[:, 1], cache.axis[:, 0])),
            units="xy",
            offsets=cache.positions,
            offset_transform=panel.transData,
            facecolors="none",
            edgecolors="#3aa6ff",
            linewidths=0.35,
        )
    )


def _add_segments(panel: Axes, scene: FlatlandScene) -> None:
    for segment in scene.segments:
        x, y = (segment.start.x, segment.end.x), (segment.start.y, segment.end.y)
        panel.plot(x, y, color="#d9a400" if segment.radiance > 0 else "#d62728", linewidth=1.5)
