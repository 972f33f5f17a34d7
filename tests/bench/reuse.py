"""What a cache that is there already saves: a new camera, and a sweep of cameras, against the first picture.

Every picture is asked for with the same error, by the way that users take: jobs of one server, whose cache is empty at
first. CPU seconds are those of the jobs, preparation included; rays are the same to the last digit for the same code.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import fogbank
from fogbank import camera_path

from tests.bench import engines

SCENES = ("shafts", "penumbra")
SIDE = 128
ERROR = 0.05
FRAMES = 60
DEGREES = 60.0
"""Of the whole sweep, around the middle of the view."""
NEW_FRAME = 30
"""The camera that is new to a warm cache."""


@dataclass(frozen=True)
class Cost:
    """Of one or more pictures."""

    cpu_seconds: float = 0.0
    rays: int = 0
    records: int = 0

    def __add__(self, other: Cost) -> Cost:
        """Of both."""
        return Cost(self.cpu_seconds + other.cpu_seconds, self.rays + other.rays, self.records + other.records)


def picture(scene: fogbank.Scene, camera: Mapping[str, Any], error: float) -> Cost:
    """Renders it with what the cache holds by then."""
    job = scene.render(camera=camera, size=(SIDE, SIDE), error=error, integrator="radiance-cache")
    job.result()
    statistics = job.statistics
    assert statistics is not None
    return Cost(statistics.render_cpu_seconds, statistics.rays, statistics.records_new)


def pictures(path: Path, cameras: Sequence[int], threads: int | None, error: float, frames: int) -> list[Cost]:
    """Of frames by their numbers, one after the other, by a server of their own with an empty cache."""
    with (
        tempfile.TemporaryDirectory(prefix="fogbank-reuse-") as data,
        fogbank.connect(data=data, threads=threads) as service,
    ):
        scene = service.load(path)
        turned = camera_path.orbit(
            scene.defaults.camera_to_world, scene.bounds.center, frames, degrees=DEGREES * (frames - 1) / frames
        )
        return [picture(scene, turned[number], error) for number in cameras]


def measure(threads: int | None, error: float = ERROR, frames: int = FRAMES) -> list[dict[str, Any]]:
    """Of each scene: the first frame, a new camera on an empty cache and on a warm one, and the whole sweep."""
    results = []
    for name in SCENES:
        path = engines.ROOT / "scenes" / name / f"{name}.xml"
        new = NEW_FRAME * frames // FRAMES
        (cold,) = pictures(path, [new], threads, error, frames)
        others = [number for number in range(frames) if number != new]
        sweep = pictures(path, [*others, new], threads, error, frames)
        results.append(
            {
                "scene": name,
                "error": error,
                "frames": frames,
                "first": asdict(sweep[0]),
                "cold": asdict(cold),
                "after_first": asdict(pictures(path, [0, new], threads, error, frames)[-1]),
                "warm": asdict(sweep[-1]),
                "sweep": asdict(sum(sweep, Cost())),
            }
        )
    return results


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """Costs, and the two ratios that matter."""
    lines = [f"{'':52}{'CPU s':>9}{'rays':>14}{'new records':>13}"]
    for result in results:
        frames = result["frames"]
        rows = (
            ("first", "first frame"),
            ("cold", "new camera, empty cache"),
            ("after_first", "new camera, cache of the first frame"),
            ("warm", "new camera, cache of all other frames"),
            ("sweep", f"sweep of {frames} frames"),
        )
        lines.append(f"{result['scene']}, {SIDE}x{SIDE}, error {result['error']:g}")
        for key, what in rows:
            cost = result[key]
            lines.append(f"  {what:50}{cost['cpu_seconds']:9.2f}{cost['rays']:14,}{cost['records']:13,}")
        saved = [result["cold"][unit] / max(result["warm"][unit], 1e-9) for unit in ("cpu_seconds", "rays")]
        grown = [result["sweep"][unit] / max(result["first"][unit], 1e-9) for unit in ("cpu_seconds", "rays")]
        lines.append(f"  a warm cache saves: CPU {saved[0]:.1f}x, rays {saved[1]:.1f}x (goal 10x)")
        lines.append(f"  the sweep costs: CPU {grown[0]:.1f} first frames, rays {grown[1]:.1f} (goal 6)")
    return "\n".join(lines)
