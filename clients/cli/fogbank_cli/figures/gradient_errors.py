"""Errors of estimated gradients and Hessians in flatland, against the exact answer (method.md sections 8 and 16)."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import fogbank
import numpy as np
from fogbank.flatland import PLAIN, FlatlandEstimates, FlatlandOptions, FlatlandScene, Method, Order
from numpy.typing import NDArray

Points = NDArray[np.float64]

ZONES = ("lit", "penumbra", "umbra")

# Nearer to the line of a surface, as a share of the box's height, that surface is seen edge-on or fills half the view,
# and nothing but its distance is measured.
_OCCLUDER_MARGIN = 0.019
_LIGHT_MARGIN = 0.031

# On boundaries between zones there are no derivatives; points whose zone changes within this share of the box's
# height are left out.
_ZONE_MARGIN = 4e-4

_FEWEST_SAMPLES = 64


@dataclass(frozen=True)
class Variant:
    """One way of estimating."""

    label: str
    method: Method
    options: FlatlandOptions


@dataclass(frozen=True)
class Experiment:
    """What is drawn and measured for one order of scattering."""

    order: Order
    scene_file: str
    """In scenes/flatland."""

    resolution: int
    """Points a side of the picture."""

    samples: int
    """Directions of each of its points."""

    table_resolution: int
    """Points a side of the grid that errors are averaged over."""

    table_samples: int
    """Most directions of the table's rows."""

    variants: tuple[Variant, ...]

    march_step: Callable[[int], float] | None
    """Step through the medium, units, by number of directions; None where nothing is marched."""

    def options(self, variant: Variant, samples: int) -> FlatlandOptions:
        """The settings of a variant with so many directions."""
        options: FlatlandOptions = {**variant.options, "samples": samples}
        if self.march_step is not None:
            options["march_step"] = self.march_step(samples)
        return options


_UNAWARE = Variant("unaware", "unaware", {})
_BISECTED: FlatlandOptions = {**PLAIN, "bisections": 8}
_SUBTRACTED: FlatlandOptions = {**PLAIN, "mean_rule": True, "subtract": True}

EXPERIMENTS = {
    "single": Experiment(
        order="single",
        scene_file="box.json",
        resolution=128,
        samples=1024,
        table_resolution=48,
        table_samples=16384,
        variants=(
            _UNAWARE,
            Variant("aware", "aware", PLAIN),
            Variant("aware, bisection", "aware", _BISECTED),
            Variant("aware, bisection, sliding, mean rule", "aware", {}),
        ),
        march_step=None,
    ),
    "multiple": Experiment(
        order="multiple",
        scene_file="fog_box.json",
        resolution=48,
        samples=256,
        table_resolution=20,
        table_samples=1024,
        variants=(
            _UNAWARE,
            Variant("aware", "aware", PLAIN),
            Variant("aware, subtraction", "aware", _SUBTRACTED),
            Variant("aware, subtraction, obliquity", "aware", {**_SUBTRACTED, "obliquity": True}),
            Variant("aware, all corrections", "aware", {}),
        ),
        march_step=lambda samples: 0.4 / samples**0.5,
    ),
}

# What pictures compare with the exact answer: places in `variants`.
PICTURED = (0, 1, -1)


@dataclass(frozen=True)
class ZoneErrors:
    """Errors over the points of a zone, relative to the sum of what is estimated; NaN-free."""

    points: int
    angle: float | None
    """Median angle between the gradients in degrees; None where there is no gradient."""

    gradient: float | None
    """None where all gradients are 0; then `largest` says what was found."""

    hessian: float | None
    value: float | None
    """Bias of the value."""

    stratified: float | None
    """Bias of the stratified mean."""

    largest: float
    """Greatest absolute value, gradient or Hessian entry found."""


@dataclass(frozen=True)
class ErrorRow:
    """One line of the table."""

    samples: int
    method: str
    zones: dict[str, ZoneErrors]

    def fields(self) -> dict[str, object]:
        """For --json."""
        return {"samples": self.samples, "method": self.method, "zones": self.zones}


def grid(scene: FlatlandScene, resolution: int, margin: float = 0.0) -> Points:
    """Points (n, 2) of a regular grid over the box, row by row from below; `margin` is a share of the sides.

    The grid is moved by a thousandth of its spacing, an irrational number of units: scenes have round coordinates, and
    on a surface there is no answer.
    """
    low, high = box_of(scene)
    side = margin + (1 - 2 * margin) * (np.arange(resolution) + 0.5 + 1e-3 / np.pi) / resolution
    x, y = np.meshgrid(low[0] + side * (high[0] - low[0]), low[1] + side * (high[1] - low[1]))
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def box_of(scene: FlatlandScene) -> tuple[Points, Points]:
    """Lower left and upper right corner."""
    high = (scene.box_max.x, scene.box_max.y) if scene.HasField("box_max") else (1.0, 1.0)
    return np.array([scene.box_min.x, scene.box_min.y]), np.array(high)


def zones_of(service: fogbank.Service, scene: FlatlandScene, points: Points) -> NDArray[np.int64]:
    """Index into ZONES of each point: all lights visible as a whole, in part, not at all."""
    clear = FlatlandScene()
    clear.CopyFrom(scene)
    clear.sigma_t = 0
    lights = FlatlandScene()
    lights.CopyFrom(clear)
    del lights.segments[:]
    lights.segments.extend(segment for segment in scene.segments if segment.radiance > 0)
    seen, whole = (service.probe_flatland(s, points, method="exact", order="single").radiance for s in (clear, lights))
    zones = np.full(len(points), ZONES.index("penumbra"))
    zones[seen > whole * (1 - 1e-12)] = ZONES.index("lit")
    zones[seen <= 1e-12 * whole] = ZONES.index("umbra")
    return zones


def points_by_zone(service: fogbank.Service, scene: FlatlandScene, resolution: int) -> tuple[Points, NDArray[np.int64]]:
    """The grid's points where derivatives exist, and their zones."""
    points = grid(scene, resolution, margin=0.02)
    low, high = box_of(scene)
    height = high[1] - low[1]
    keep = np.ones(len(points), dtype=bool)
    for segment in scene.segments:
        start, end = (np.array([p.x, p.y]) for p in (segment.start, segment.end))
        along = (end - start) / np.linalg.norm(end - start)
        distance = np.abs((points - start) @ np.array([-along[1], along[0]]))
        keep &= distance > height * (_LIGHT_MARGIN if segment.radiance > 0 else _OCCLUDER_MARGIN)
    points = points[keep]
    zones = zones_of(service, scene, points)
    step = _ZONE_MARGIN * height
    stable = np.ones(len(points), dtype=bool)
    for shift in ((step, 0), (-step, 0), (0, step), (0, -step)):
        stable &= zones_of(service, scene, points + shift) == zones
    return points[stable], zones[stable]


def measure_errors(
    service: fogbank.Service, scene: FlatlandScene, experiment: Experiment, resolution: int, most_samples: int
) -> Iterator[ErrorRow]:
    """The table's rows, as they are computed."""
    points, zones = points_by_zone(service, scene, resolution)
    exact = service.probe_flatland(scene, points, method="exact", order=experiment.order)
    samples = _FEWEST_SAMPLES
    while samples <= most_samples:
        for variant in experiment.variants:
            found = service.probe_flatland(
                scene, points, method=variant.method, order=experiment.order, **experiment.options(variant, samples)
            )
            errors = {zone: _errors(exact, found, zones == index) for index, zone in enumerate(ZONES)}
            yield ErrorRow(samples, variant.label, errors)
        samples *= 4


def _errors(exact: FlatlandEstimates, found: FlatlandEstimates, where: NDArray[np.bool_]) -> ZoneErrors:
    truth, guess = exact.gradient[where], found.gradient[where]
    true_lengths, lengths = np.linalg.norm(truth, axis=1), np.linalg.norm(guess, axis=1)
    both = (true_lengths > 0) & (lengths > 0)
    cosines = np.sum(truth[both] * guess[both], axis=1) / (true_lengths[both] * lengths[both])
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))

    def relative(error: float, size: float) -> float | None:
        return float(error / size) if size > 0 else None

    size = exact.radiance[where].sum()
    values = (found.radiance[where], guess, found.hessian[where])
    return ZoneErrors(
        points=int(where.sum()),
        angle=float(np.median(angles)) if len(angles) else None,
        gradient=relative(np.linalg.norm(guess - truth, axis=1).sum(), true_lengths.sum()),
        hessian=relative(
            np.linalg.norm(found.hessian[where] - exact.hessian[where], axis=(1, 2)).sum(),
            np.linalg.norm(exact.hessian[where], axis=(1, 2)).sum(),
        ),
        value=relative((found.radiance[where] - exact.radiance[where]).sum(), size),
        stratified=relative((found.stratified_mean[where] - exact.radiance[where]).sum(), size),
        largest=float(max((np.abs(value).max(initial=0) for value in values), default=0)),
    )


COLUMNS = ("zone", "points", "angle", "gradient", "hessian", "value", "stratified", "largest")


def write_csv(rows: Sequence[ErrorRow], path: Path) -> None:
    """One line per number of samples, method and zone: errors as fractions, angles in degrees, empty if undefined."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("samples", "method", *COLUMNS))
        for row in rows:
            for zone, errors in row.zones.items():
                numbers = (getattr(errors, column) for column in COLUMNS[2:])
                cells = ("" if number is None else f"{number:.6g}" for number in numbers)
                writer.writerow((row.samples, row.method, zone, errors.points, *cells))


def markdown(rows: Sequence[ErrorRow]) -> Iterator[str]:
    """The table as Markdown: median angle / gradient / Hessian / bias of the value, in degrees and per cent."""
    if not rows:
        return
    shown = [zone for zone in ZONES if rows[0].zones[zone].points]
    header = [f"{zone} ({rows[0].zones[zone].points} points)" for zone in shown]
    yield "Median angle in degrees / gradient / Hessian / bias of the value."
    yield ""
    yield f"| N | method | {' | '.join(header)} |"
    yield f"|---|---|{'---|' * len(shown)}"
    for row in rows:
        yield f"| {row.samples} | {row.method} | {' | '.join(_cell(row.zones[zone]) for zone in shown)} |"


def _cell(errors: ZoneErrors) -> str:
    if errors.gradient is None or errors.hessian is None or errors.value is None:
        return "all exactly 0" if errors.largest == 0 else f"up to {errors.largest:.2g} instead of 0"
    angle = "-" if errors.angle is None else _digits(errors.angle)
    numbers = " / ".join(f"{_digits(100 * error)} %" for error in (errors.gradient, errors.hessian))
    # Adding 0 turns -0.0 into 0.0.
    return f"{angle} / {numbers} / {round(100 * errors.value, 2) + 0.0:+.2f} %"


def _digits(number: float) -> str:
    """Two significant digits, at most two decimals: 210, 60, 4.7, 0.24, 0.01."""
    return f"{number:.0f}" if number >= 9.95 else f"{number:.1f}" if number >= 0.995 else f"{number:.2f}"
