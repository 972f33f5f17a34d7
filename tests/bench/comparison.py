"""Speed and noise of Fogbank's `volpath` against Mitsuba 3's on the same scenes.

All engines render each scene at the same size, depth and samples per pixel, with the filter box (any other makes
Mitsuba weight the samples of neighbouring pixels). Russian roulette begins where each engine's user would have it: for
Mitsuba where the scene's file says, unless told otherwise, for Fogbank at its own default. In every round each engine
renders once, in turn and with a seed of its own, so that whatever else the machine does meets all of them. Before the
first round each renders once without being measured: start-up, loading and just-in-time compilation are not counted.

* Speed: camera samples per CPU second (all threads), summed over the rounds. The ratios' range is that of the rounds.
* Noise: V, the variance of a pixel's luminance over an engine's rounds, divided by (L + M / 10)^2, where L is the mean
  over all rounds of all engines and over the 5 x 5 pixels around it (noise in L itself would hide noise in V) and M the
  mean of L over the image; then the mean over the pixels without the largest 0.1 % (single fireflies would decide it
  otherwise; with them it is given as well).
* Cost: noise x CPU seconds of one round, i.e. CPU seconds to a relative variance of 1. It doesn't depend on the number
  of samples, since noise falls as time grows.
* Agreement: image means, as a difference in standard errors (from the rounds).
"""

from __future__ import annotations

import contextlib
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR

from tests.bench import engines

Pixels = npt.NDArray[np.float64]

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
TRIMMED = 0.001
MITSUBA_VARIANTS = ("llvm_ad_rgb", "scalar_rgb")


@dataclass(frozen=True)
class Case:
    """A scene and how it is rendered."""

    name: str
    path: Path
    width: int
    height: int
    max_depth: int
    mitsuba_rr_depth: int

    def scaled(self, factor: float) -> Case:
        """The same in another size."""
        return replace(self, width=round(self.width * factor), height=round(self.height * factor))


@dataclass
class Runs:
    """What one engine's rounds gave."""

    cpu_seconds: list[float] = field(default_factory=list)
    samples: int = 0
    images: list[Pixels] = field(default_factory=list)


@dataclass(frozen=True)
class Figures:
    """One engine on one scene."""

    engine: str
    samples_per_cpu_second: float
    cpu_seconds: list[float]
    noise: float
    noise_with_fireflies: float
    cost: float
    image_mean: float
    image_mean_standard_error: float


def cases() -> list[Case]:
    """The scenes that are there."""
    scenes = engines.ROOT / "scenes"
    every = [
        Case("shafts", scenes / "shafts" / "shafts.xml", 256, 256, 16, 8),
        Case("glow", scenes / "glow" / "glow.xml", 256, 256, 100, 50),
        Case("room_fog", engines.SHARED / "data" / "statues" / "room_fog.xml", 256, 144, 24, 8),
    ]
    return [case for case in every if case.path.exists()]


def luminance(path: Path) -> Pixels:
    """Luminance of an EXR file with the channels R, G, B."""
    rgb = OpenEXR.File(str(path)).channels()["RGB"].pixels
    return np.asarray(np.asarray(rgb, dtype=np.float64) @ LUMINANCE)


def blurred(pixels: Pixels) -> Pixels:
    """Mean over 5 x 5 pixels, fewer at the edges."""
    radius = 2
    height, width = pixels.shape
    shifts = [(y, x) for y in range(2 * radius + 1) for x in range(2 * radius + 1)]
    padded = np.pad(pixels, radius)
    inside = np.pad(np.ones_like(pixels), radius)
    total = np.sum([padded[y : y + height, x : x + width] for y, x in shifts], axis=0)
    count = np.sum([inside[y : y + height, x : x + width] for y, x in shifts], axis=0)
    return np.asarray(total / count)


def figures(engine: str, runs: Runs, reference: Pixels) -> Figures:
    """See the module's text."""
    images = np.stack(runs.images)
    relative = images.var(axis=0, ddof=1) / (reference + 0.1 * reference.mean()) ** 2
    ordered = np.sort(relative.ravel())
    kept = ordered[: ordered.size - round(ordered.size * TRIMMED)]
    means = images.mean(axis=(1, 2))
    seconds = float(np.mean(runs.cpu_seconds))
    return Figures(
        engine=engine,
        samples_per_cpu_second=runs.samples / sum(runs.cpu_seconds),
        cpu_seconds=runs.cpu_seconds,
        noise=float(kept.mean()),
        noise_with_fireflies=float(relative.mean()),
        cost=float(kept.mean()) * seconds,
        image_mean=float(means.mean()),
        image_mean_standard_error=float(means.std(ddof=1) / np.sqrt(len(means))),
    )


def compare(case: Case, samples_per_pixel: int, rounds: int, threads: int) -> dict[str, Any]:
    """Runs one scene through all engines."""
    engines.OUTPUT.mkdir(parents=True, exist_ok=True)
    runs: dict[str, Runs] = {}
    with contextlib.ExitStack() as stack:
        running = {"fogbank": stack.enter_context(engines.fogbank())}
        for variant in MITSUBA_VARIANTS:
            running[variant] = stack.enter_context(engines.mitsuba(variant))
        for name, engine in running.items():
            runs[name] = Runs()
            size = {} if name == "fogbank" else {"width": case.width, "height": case.height}
            engine.ask("load", scene=str(case.path), **size)
        for index in range(rounds + 1):
            for name, engine in running.items():
                output = engines.OUTPUT / f"{case.name}_{name}.exr"
                own = (
                    {"width": case.width, "height": case.height, "threads": threads}
                    if name == "fogbank"
                    else {"rr_depth": case.mitsuba_rr_depth}
                )
                answer = engine.ask(
                    "render",
                    samples_per_pixel=samples_per_pixel,
                    max_depth=case.max_depth,
                    seed=index,
                    output=str(output),
                    **own,
                )
                if index == 0:
                    continue
                runs[name].cpu_seconds.append(answer["cpu_seconds"])
                runs[name].samples += answer["samples"]
                runs[name].images.append(luminance(output))
    reference = blurred(np.mean([np.mean(run.images, axis=0) for run in runs.values()], axis=0))
    result = {name: figures(name, run, reference) for name, run in runs.items()}
    return {
        "scene": case.name,
        "width": case.width,
        "height": case.height,
        "max_depth": case.max_depth,
        "mitsuba_rr_depth": case.mitsuba_rr_depth,
        "samples_per_pixel": samples_per_pixel,
        "rounds": rounds,
        "engines": [asdict(value) for value in result.values()],
        "against": {variant: ratios(result["fogbank"], result[variant]) for variant in MITSUBA_VARIANTS},
    }


def ratios(ours: Figures, theirs: Figures) -> dict[str, Any]:
    """How much better we are: above 1 is better."""
    per_round = np.array(theirs.cpu_seconds) / np.array(ours.cpu_seconds)
    error = np.hypot(ours.image_mean_standard_error, theirs.image_mean_standard_error)
    return {
        "speed": ours.samples_per_cpu_second / theirs.samples_per_cpu_second,
        "speed_of_rounds": [float(per_round.min()), float(per_round.max())],
        "noise": theirs.noise / ours.noise,
        "noise_with_fireflies": theirs.noise_with_fireflies / ours.noise_with_fireflies,
        "cost": theirs.cost / ours.cost,
        "difference_in_standard_errors": float((ours.image_mean - theirs.image_mean) / error),
    }


def table(results: list[dict[str, Any]]) -> str:
    """For people."""
    lines = [
        "scene      engine        samples/CPU s     noise   CPU s x noise   speed  noise   cost  mean differs by",
        "-" * 104,
    ]
    for result in results:
        for engine in result["engines"]:
            line = (
                f"{result['scene']:10} {engine['engine']:12} {engine['samples_per_cpu_second']:14,.0f}"
                f" {engine['noise']:9.4g} {engine['cost']:15.4g}"
            )
            against = result["against"].get(engine["engine"])
            if against:
                line += (
                    f"  x{against['speed']:5.2f} x{against['noise']:5.2f} x{against['cost']:5.2f}"
                    f" {against['difference_in_standard_errors']:9.1f} s.e."
                )
            lines.append(line)
    lines.append(
        "Ratios: how many times better Fogbank is than the engine of the line; cost is speed and noise together."
    )
    return "\n".join(lines)
