"""Errors of pictures from the two-dimensional cache, against the exact answer (method.md section 16)."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import fogbank
import numpy as np
from fogbank.flatland import PLAIN, FlatlandOptions, FlatlandScene, Method
from fogbank.flatland_cache import FlatlandCache, FlatlandExtents
from numpy.typing import NDArray

from fogbank_cli.figures.gradient_errors import ZONES, Points, box_of, grid, zones_of

# Of error integrals, as shares of the box's area.
_SECOND_ORDER = (1e-3, 2.5e-4, 6.4e-5, 1.6e-5, 4e-6, 1e-6)
# Of changes across a radius.
_FIRST_ORDER = (1.6, 0.8, 0.4, 0.2, 0.1, 0.05)

# Points a side of the coarse grid that gets records in any case.
_PILOT_SIDE = 8


@dataclass(frozen=True)
class Variant:
    """One kind of cache."""

    label: str
    method: Method
    options: FlatlandOptions
    extents: FlatlandExtents

    @property
    def thresholds(self) -> tuple[float, ...]:
        """Of its runs, from coarse to fine."""
        return _FIRST_ORDER if self.extents.get("metric") == "first-order" else _SECOND_ORDER


_CLAMP_ALONE: FlatlandExtents = {"visibility_margin": False, "verify": False}

RIVAL = Variant("unaware, first-order radius", "unaware", {}, {"metric": "first-order"})
UNAWARE = Variant("unaware", "unaware", {}, {})
AWARE = Variant("aware", "aware", PLAIN, {})
CORRECTED = Variant("aware, corrected", "aware", {}, {})
CIRCLES = Variant("aware, corrected, circles", "aware", {}, {"shape": "circle"})

VARIANTS = (
    RIVAL,
    UNAWARE,
    Variant("aware, neighbour clamp alone", "aware", PLAIN, _CLAMP_ALONE),
    AWARE,
    CORRECTED,
    CIRCLES,
    Variant("exact derivatives", "exact", {}, {}),
)


@dataclass(frozen=True)
class Picture:
    """A regular grid of points over the box, and what is true there."""

    resolution: int
    points: Points
    """(resolution^2, 2), row by row from below"""

    exact: NDArray[np.float64]
    """(resolution^2,); mean radiance"""

    penumbra: NDArray[np.bool_]
    """(resolution^2,)"""

    @property
    def order(self) -> NDArray[np.int64]:
        """Rows of `points` in the order in which they ask for records: strides halve, the pilot comes first."""
        side = np.arange(self.resolution)
        # A point is met at the first stride whose grid holds both of its coordinates.
        met = np.ones((self.resolution, self.resolution), dtype=np.int64)
        stride = 1
        while stride <= self._first_stride:
            on = side % stride == stride // 2
            met[np.ix_(on, on)] = stride
            stride *= 2
        return np.argsort(-met.ravel(), kind="stable")

    @property
    def pilot(self) -> int:
        """Points of the coarsest stride."""
        return len(range(self._first_stride // 2, self.resolution, self._first_stride)) ** 2

    @property
    def _first_stride(self) -> int:
        return 1 << max(0, (self.resolution // _PILOT_SIDE).bit_length() - 1)


@dataclass(frozen=True)
class CacheRow:
    """One line of the table; errors are relative to the mean radiance of the points they are taken over."""

    method: str
    threshold: float
    records: int
    penumbra_rmse: float
    rmse: float
    rays: int


@dataclass(frozen=True)
class Run:
    """A filled cache with its errors."""

    variant: Variant
    row: CacheRow
    radiance: NDArray[np.float64]
    """Of the picture's points, in their order."""

    cache: FlatlandCache


def make_picture(service: fogbank.Service, scene: FlatlandScene, resolution: int) -> Picture:
    """The points with their exact radiance of single scattering."""
    points = grid(scene, resolution)
    exact = service.probe_flatland(scene, points, method="exact", order="single").radiance
    return Picture(resolution, points, exact, zones_of(service, scene, points) == ZONES.index("penumbra"))


def fill(
    service: fogbank.Service,
    scene: FlatlandScene,
    picture: Picture,
    variant: Variant,
    threshold: float,
    samples: int,
) -> Run:
    """Fills a cache for the picture."""
    low, high = box_of(scene)
    unit = 1.0 if variant.extents.get("metric") == "first-order" else float(np.prod(high - low))
    options: FlatlandOptions = {**variant.options, "samples": samples}
    extents: FlatlandExtents = {**variant.extents, "pilot": picture.pilot}
    order = picture.order
    cache = service.fill_flatland_cache(
        scene, picture.points[order], threshold * unit, extents, method=variant.method, order="single", **options
    )
    radiance = np.empty_like(picture.exact)
    radiance[order] = cache.radiance

    def rmse(where: NDArray[np.bool_]) -> float:
        if not where.any():
            return 0.0
        error = radiance[where] - picture.exact[where]
        return float(np.sqrt(np.mean(error**2)) / (picture.exact[where].mean() or 1.0))

    row = CacheRow(
        method=variant.label,
        threshold=threshold,
        records=len(cache.positions),
        penumbra_rmse=rmse(picture.penumbra),
        rmse=rmse(np.ones_like(picture.penumbra)),
        rays=cache.rays,
    )
    return Run(variant, row, radiance, cache)


def sweep(
    service: fogbank.Service,
    scene: FlatlandScene,
    picture: Picture,
    samples: int,
    variants: Sequence[Variant] = VARIANTS,
) -> Iterator[Run]:
    """All variants at all their thresholds."""
    for variant in variants:
        for threshold in variant.thresholds:
            yield fill(service, scene, picture, variant, threshold, samples)


COLUMNS = ("method", "threshold", "records", "penumbra_rmse", "rmse", "rays")


def write_csv(rows: Sequence[CacheRow], path: Path) -> None:
    """One line per row of the table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow(
                (row.method, f"{row.threshold:g}", row.records, f"{row.penumbra_rmse:.6g}", f"{row.rmse:.6g}", row.rays)
            )


def markdown(rows: Sequence[CacheRow]) -> Iterator[str]:
    """The table as Markdown: a line per method; records: RMSE over the penumbra / over all points, of their means."""
    yield "Records: RMSE in penumbrae / everywhere, relative to the mean there."
    yield ""
    methods = list(dict.fromkeys(row.method for row in rows))
    runs = {method: [row for row in rows if row.method == method] for method in methods}
    width = max((len(run) for run in runs.values()), default=0)
    yield f"| method | {' | '.join(f'run {k + 1}' for k in range(width))} |"
    yield f"|---|{'---|' * width}"
    for method, run in runs.items():
        cells = (f"{row.records}: {row.penumbra_rmse:.3f} / {row.rmse:.3f}" for row in run)
        yield f"| {method} | {' | '.join(cells)} |"
