"""What a farm costs on one machine: two single-threaded workers against one server of two threads.

    python -m tests.bench.farm_overhead [SCENE.xml] [--integrator volpath] [--spp 256] [--size 256] [--repeats 1]

Both make the same picture, one after the other, with empty caches and everything warm that a farm keeps running: a
worker's server is started by a tiny picture before. Printed are wall-clock seconds from the call to the picture, CPU
seconds of all processes, and the machine's load before, which says how far to trust the former.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import fogbank
import numpy as np
import psutil
from fogbank import RenderOptions, farm

ROOT = Path(__file__).resolve().parents[2]
THREADS = 2


@dataclass(frozen=True)
class Spent:
    """What a picture took."""

    seconds: float
    """Wall clock."""

    cpu_seconds: dict[str, float]
    """By kind of process: "Python" (this one, with Dask's scheduler and workers), "servers"."""

    image: fogbank.Image
    """The picture."""


def cpu_by_kind() -> dict[str, float]:
    """CPU seconds so far of this process and of all below it."""
    this = psutil.Process()
    totals = {"Python": sum(this.cpu_times()[:2]), "servers": 0.0}
    for child in this.children(recursive=True):
        times = child.cpu_times()
        totals["servers"] += times.user + times.system
    return totals


def spent_on(start: Callable[[], fogbank.Job]) -> Spent:
    """Renders, and measures."""
    before, began = cpu_by_kind(), time.monotonic()
    image = start().result()
    seconds, after = time.monotonic() - began, cpu_by_kind()
    return Spent(seconds, {kind: after[kind] - before[kind] for kind in after}, image)


def by_one_server(scene: Path, options: RenderOptions) -> Spent:
    """On one server of two threads."""
    with tempfile.TemporaryDirectory() as folder, fogbank.connect(data=Path(folder), threads=THREADS) as service:
        loaded = service.load(scene)
        loaded.render(integrator="volpath", size=(16, 16), spp=1).wait()
        return spent_on(lambda: loaded.render(**options))


def by_a_farm(scene: Path, options: RenderOptions) -> Spent:
    """On two workers of one thread."""
    with (
        tempfile.TemporaryDirectory() as folder,
        fogbank.connect(data=Path(folder), threads=THREADS) as service,
        farm.local_cluster(THREADS) as client,
    ):
        loaded = service.load(scene)
        farm.render(loaded, client, integrator="volpath", size=(64, 64), spp=1).wait()
        jobs: list[farm.FarmJob] = []

        def start() -> fogbank.Job:
            jobs.append(farm.render(loaded, client, **options))
            return jobs[0]

        spent = spent_on(start)
        jobs[0].join_farm()
        for kind, figures in jobs[0].farm.kinds.items():
            moved = (figures.input_bytes + figures.result_bytes) / max(figures.tasks, 1)
            print(f"  {kind}: {figures.tasks} tasks, {figures.cpu_seconds:.1f} CPU s, {moved:.0f} bytes each")
        stages = len(jobs[0].farm.stages)
        print(f"  {jobs[0].farm.batches} batches in {stages} stages, {jobs[0].farm.log_bytes} bytes of log")
        return spent


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "scenes" / "shafts" / "shafts.xml")
    parser.add_argument("--integrator", default="volpath")
    parser.add_argument("--size", type=int, default=256, help="side of the film in pixels")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--error", type=float)
    parser.add_argument("--repeats", type=int, default=1)
    given = parser.parse_args()
    options = RenderOptions(
        integrator=given.integrator, size=(given.size, given.size), spp=given.spp, pixel_type="float"
    )
    if given.error is not None:
        options["error"] = given.error
    walls: dict[str, list[float]] = {}
    cpus: dict[str, list[float]] = {}
    for _ in range(given.repeats):
        pictures = []
        for name, way in (("one server", by_one_server), ("farm", by_a_farm)):
            load = os.getloadavg()[0]
            spent = way(given.scene, options)
            pictures.append(np.asarray(spent.image))
            total = sum(spent.cpu_seconds.values())
            walls.setdefault(name, []).append(spent.seconds)
            cpus.setdefault(name, []).append(total)
            parts = ", ".join(f"{kind} {seconds:.1f}" for kind, seconds in spent.cpu_seconds.items())
            print(f"{name}: {spent.seconds:.1f} s wall, {total:.1f} s CPU ({parts}), load {load:.1f} before")
        np.testing.assert_array_equal(pictures[0], pictures[1])
    for what, figures in (("wall", walls), ("CPU", cpus)):
        ratio = statistics.median(figures["farm"]) / statistics.median(figures["one server"])
        print(f"farm / one server, {what}: {ratio:.3f}")


if __name__ == "__main__":
    main()
