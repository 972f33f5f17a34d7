"""References: two independent halves by path tracing, made until their noise is known to be small.

`NAME.exr` is their mean, `NAME_a.exr` and `NAME_b.exr` are the halves. Their headers say, as JSON in the attribute
`fogbank:reference`, what they are of and how good (`ReferenceState`): an interrupted reference goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import OpenEXR

import fogbank
from fogbank.comparison.exr_writer import write_exr
from fogbank.comparison.image_error import Pixels, read, residual
from fogbank.errors import InvalidArgumentError

ATTRIBUTE = "fogbank:reference"
INTEGRATOR = "volpath"
_FIRST_SEED = 1 << 40
"""Far from the seeds that pictures are rendered with: equal seeds give equal samples."""
_PILOT_SAMPLES = 4
_ROUNDS = 10
_LONGEST_ROUND_SECONDS = 120.0
"""What an interruption can lose."""


@dataclass(frozen=True)
class ReferenceState:
    """How far a half or the mean is."""

    scene: str
    """The scene's name on the server: its fingerprint."""

    size: tuple[int, int]
    """Width and height in pixels."""

    max_depth: int
    """Greatest path length in edges."""

    integrator: str = INTEGRATOR
    """What it is rendered with."""

    rounds: int = 0
    """Renders with a seed of their own that it is the mean of."""

    samples_per_pixel: int = 0
    """In all."""

    seconds: float = 0.0
    """Wall-clock seconds of rendering."""

    cpu_seconds: float = 0.0
    """The same of all threads."""

    residual: float | None = None
    """Of the mean only: relative error that noise leaves, the root of `image_error.residual`."""


@dataclass(frozen=True)
class Reference:
    """What pictures are measured against."""

    half_a: Pixels
    """Linear Rec. 709, (height, width, 3)."""

    half_b: Pixels
    """The same with independent noise; the same picture again where there is only one."""

    independent: bool
    """Whether the halves are; else the reference's noise counts as error of the pictures."""

    description: str
    """For people."""

    @property
    def mean(self) -> Pixels:
        """The best picture there is."""
        return (self.half_a + self.half_b) / 2

    @property
    def residual(self) -> float | None:
        """Relative error that noise leaves in the mean; None where it is unknown."""
        return math.sqrt(residual(self.half_a, self.half_b)) if self.independent else None

    @property
    def sha256(self) -> str:
        """Identifies it."""
        return hashlib.sha256(self.half_a.tobytes() + self.half_b.tobytes()).hexdigest()


Sink: TypeAlias = Callable[[ReferenceState], None]


def halves_of(path: Path) -> tuple[Path, Path]:
    """Where the halves of a reference lie."""
    return path.with_name(f"{path.stem}_a{path.suffix}"), path.with_name(f"{path.stem}_b{path.suffix}")


def load_reference(path: Path) -> Reference:
    """Reads a reference, with its halves where they lie beside it.

    Raises OSError or DataLossError for what can't be read.
    """
    half_a, half_b = halves_of(path)
    if half_a.is_file() and half_b.is_file():
        a, b = read(half_a), read(half_b)
        state = read_state(path) if path.is_file() else None
        made = f", {INTEGRATOR}, {state.samples_per_pixel} samples per pixel" if state else ""
        reference = Reference(a, b, True, f"{path.name}, two independent halves{made}")
        if a.shape != b.shape:
            raise InvalidArgumentError(f"{half_a.name} and {half_b.name} differ in size")
        return reference
    whole = read(path)
    return Reference(whole, whole, False, f"{path.name}, one picture: its own noise counts as error of every method")


def read_state(path: Path) -> ReferenceState | None:
    """What the header says; None for a file without it."""
    with OpenEXR.File(str(path), header_only=True) as file:
        text = file.header().get(ATTRIBUTE)
    if text is None:
        return None
    fields = json.loads(text)
    return ReferenceState(**{**fields, "size": tuple(fields["size"])})


def make_reference(
    scene: fogbank.Scene,
    path: Path,
    *,
    seconds: float,
    error: float | None = None,
    size: tuple[int, int] | None = None,
    max_depth: int | None = None,
    threads: int | None = None,
    on_progress: Sink | None = None,
) -> ReferenceState:
    """Makes a reference, or goes on with the one that is there.

    Every round renders a number of samples that is fixed before, so that no result decides about its own weight.

    Args:
        scene: to render; references of comparisons have the filter box (`scene_text`).
        path: NAME.exr.
        seconds: wall-clock seconds of rendering in all, those of earlier runs included; a tenth may be added.
        error: ends earlier when the residual is no greater; relative, root mean square.
        size: width and height; the scene's by default.
        max_depth: greatest path length; the scene's by default.
        threads: most threads.
        on_progress: is told after every round.

    Raises InvalidArgumentError when the files are of another scene, size or depth.
    """
    wanted = ReferenceState(
        scene.name, size or scene.defaults.size, scene.defaults.max_depth if max_depth is None else max_depth
    )
    halves = [_Half(half, wanted, seed) for seed, half in enumerate(halves_of(path))]
    pace = 0.0
    while True:
        if halves[0].state.rounds == halves[1].state.rounds > 0:
            state = _write_mean(path, halves)
            if on_progress is not None:
                on_progress(state)
            if state.seconds >= seconds or (error is not None and (state.residual or 0.0) <= error):
                return state
        half = min(halves, key=lambda half: half.state.rounds)
        samples = _PILOT_SAMPLES
        if pace > 0.0:
            round_seconds = min(seconds / _ROUNDS, _LONGEST_ROUND_SECONDS)
            samples = max(1, int(round_seconds / 2 / pace))
        if half is halves[1] and halves[0].last_samples:
            samples = halves[0].last_samples
        pace = half.render(scene, samples, threads)


class _Half:
    """One of the two, on the disk."""

    def __init__(self, path: Path, wanted: ReferenceState, number: int) -> None:
        self._path = path
        self._number = number
        self.last_samples = 0
        self.state = wanted
        self.pixels: Pixels = np.zeros((wanted.size[1], wanted.size[0], 3))
        if not path.is_file():
            return
        found = read_state(path)
        same = ("scene", "size", "max_depth", "integrator")
        if found is None or any(getattr(found, name) != getattr(wanted, name) for name in same):
            raise InvalidArgumentError(
                f"{path} is there and of another scene, size or depth; remove it or choose another name",
                metadata={"field": "output"},
            )
        self.state = found
        self.pixels = read(path)

    def render(self, scene: fogbank.Scene, samples: int, threads: int | None) -> float:
        """Adds a round; seconds a sample of every pixel took."""
        state = self.state
        job = scene.render(
            integrator=state.integrator,
            spp=samples,
            size=state.size,
            max_depth=state.max_depth,
            seed=_FIRST_SEED + 2 * state.rounds + self._number,
            pixel_type="float",
            threads=threads,
        )
        try:
            image = job.result()
        except BaseException:
            job.cancel()
            raise
        statistics = job.statistics
        if statistics is None:
            raise fogbank.InternalError(f"{job.name} succeeded and has no result")
        total = state.samples_per_pixel + samples
        self.pixels = (self.pixels * state.samples_per_pixel + np.asarray(image, dtype=np.float64) * samples) / total
        self.state = replace(
            state,
            rounds=state.rounds + 1,
            samples_per_pixel=total,
            seconds=state.seconds + statistics.render_seconds,
            cpu_seconds=state.cpu_seconds + statistics.render_cpu_seconds,
        )
        self.last_samples = samples
        write_exr(self._path, self.pixels, {ATTRIBUTE: json.dumps(asdict(self.state))})
        return statistics.render_seconds / samples


def _write_mean(path: Path, halves: list[_Half]) -> ReferenceState:
    a, b = halves
    state = replace(
        a.state,
        samples_per_pixel=a.state.samples_per_pixel + b.state.samples_per_pixel,
        seconds=a.state.seconds + b.state.seconds,
        cpu_seconds=a.state.cpu_seconds + b.state.cpu_seconds,
        residual=math.sqrt(residual(a.pixels, b.pixels)),
    )
    write_exr(path, (a.pixels + b.pixels) / 2, {ATTRIBUTE: json.dumps(asdict(state))})
    return state
