"""How much of a render's time is ray tracing proper, and how fast Embree alone would trace the same rays.

Measured with one thread and a library that stands between the engine and Embree (embree_probe.cpp). It reads a clock of
wall time, as one of the thread's CPU time costs as much as a ray; what other processes took is removed by scaling with
the render's own ratio of CPU to wall time. All rates are per CPU second.
"""

from __future__ import annotations

from typing import Any

from tests.bench import engines
from tests.bench.comparison import Case


def measure(case: Case, samples_per_pixel: int) -> dict[str, Any]:
    """Embree's share of the render's time; rays per CPU second of the render, of Embree in it, of Embree alone."""

    def render(mode: str) -> dict[str, Any]:
        environment = {"LD_PRELOAD": str(engines.BINARIES / "libembree_probe.so"), "EMBREE_PROBE": mode}
        with engines.fogbank(environment) as engine:
            engine.ask("load", scene=str(case.path))
            return engine.ask(
                "render",
                width=case.width,
                height=case.height,
                samples_per_pixel=samples_per_pixel,
                max_depth=case.max_depth,
                seed=0,
                threads=1,
                output="",
            )

    timed, replayed = render("time"), render("replay")
    embree = timed["embree"]["seconds"] * timed["cpu_seconds"] / timed["wall_seconds"]
    alone = replayed["embree"]["replay_seconds"] * replayed["cpu_seconds"] / replayed["wall_seconds"]
    return {
        "scene": case.name,
        "rays_per_sample": timed["rays"] / timed["samples"],
        "embree_share": embree / timed["cpu_seconds"],
        "rays_per_second": timed["rays"] / timed["cpu_seconds"],
        "embree_rays_per_second": timed["embree"]["rays"] / embree,
        "bare_embree_rays_per_second": replayed["embree"]["replayed_rays"] / alone,
    }


def table(results: list[dict[str, Any]]) -> str:
    """For people."""
    lines = ["scene      rays/sample  Embree's share   rays/CPU s: render   Embree in it   Embree alone"]
    lines += [
        f"{result['scene']:10} {result['rays_per_sample']:11.1f} {result['embree_share']:14.0%}"
        f" {result['rays_per_second']:16,.0f} {result['embree_rays_per_second']:14,.0f}"
        f" {result['bare_embree_rays_per_second']:14,.0f}"
        for result in results
    ]
    return "\n".join(lines)
