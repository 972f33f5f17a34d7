"""What the service adds to rendering: start, first tile, streaming, and how jobs share the cores."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import fogbank
import psutil
from fogbank.embedded import EmbeddedServer

from tests.bench.comparison import Case

FIRST_TILES = 7
STREAMED_JOBS = 3
SIMULTANEOUS_JOBS = 8


def server_cpu_seconds(server: EmbeddedServer) -> float:
    """All threads, since the start."""
    times = psutil.Process(server.process_id).cpu_times()
    return float(times.user + times.system)


def first_tile_seconds(scene: fogbank.Scene, case: Case, seed: int) -> float:
    """From the request for a job to its first decoded tile, with the scene loaded already."""
    start = time.perf_counter()
    job = scene.render(size=(case.width, case.height), max_depth=case.max_depth, spp=16, seed=seed)
    next(iter(job.tiles()))
    seconds = time.perf_counter() - start
    job.cancel()
    job.wait()
    return seconds


def job_overhead(server: EmbeddedServer, scene: fogbank.Scene, case: Case, spp: int, *, watched: bool) -> float:
    """CPU time of the server besides the job's render proper, as a share of the latter."""
    before = server_cpu_seconds(server)
    job = scene.render(size=(case.width, case.height), max_depth=case.max_depth, spp=spp, seed=spp)
    if watched:
        for _ in job.tiles():
            pass
    job.wait()
    spent = server_cpu_seconds(server) - before
    result = job.statistics
    assert result is not None
    return spent / result.render_cpu_seconds - 1


def fairness(scene: fogbank.Scene, case: Case, seconds: float) -> list[float]:
    """Shares of the work that equal jobs, begun together, have done after a while; the mean is 1."""
    jobs = [
        scene.render(size=(case.width, case.height), max_depth=case.max_depth, spp=4096, seed=seed)
        for seed in range(SIMULTANEOUS_JOBS)
    ]
    time.sleep(seconds)
    done = [job.refresh().progress.rays for job in jobs]
    for job in jobs:
        job.cancel()
    for job in jobs:
        job.wait()
    return [rays / statistics.mean(done) for rays in done]


def measure(case: Case, spp: int) -> dict[str, Any]:
    """All of it, on one scene."""
    starts, start_cpu = [], []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(4):
            start = time.perf_counter()
            server = EmbeddedServer(data=Path(folder) / str(index))
            service = fogbank.connect(server.target)
            starts.append(time.perf_counter() - start)
            start_cpu.append(server_cpu_seconds(server))
            if index < 3:
                service.close()
                server.stop()
        scene = service.load(case.path)
        # The first job loads the scene into memory and the code into the caches.
        first_tile_seconds(scene, case, seed=1)
        first_tiles = [first_tile_seconds(scene, case, seed=2 + index) for index in range(FIRST_TILES)]
        unwatched, watched = [], []
        for _ in range(STREAMED_JOBS):
            unwatched.append(job_overhead(server, scene, case, spp, watched=False))
            watched.append(job_overhead(server, scene, case, spp, watched=True))
        shares = fairness(scene, case, seconds=10)
        service.close()
        server.stop()
    return {
        "scene": case.name,
        "start_seconds": starts,
        "start_cpu_seconds": start_cpu,
        "first_tile_seconds": first_tiles,
        "overhead_unwatched": unwatched,
        "overhead_watched": watched,
        "fairness": shares,
    }


def table(result: dict[str, Any]) -> str:
    """For people."""
    starts, tiles = result["start_seconds"], result["first_tile_seconds"]
    watched, unwatched = (statistics.median(result[f"overhead_{name}"]) for name in ("watched", "unwatched"))
    shares = result["fairness"]
    return "\n".join(
        [
            f"server start to ready     {statistics.median(starts):.3f} s (of {len(starts)}; most {max(starts):.3f} s),"
            f" {statistics.median(result['start_cpu_seconds']):.3f} CPU s",
            f"first tile at the client  {statistics.median(tiles):.3f} s (of {len(tiles)}; most {max(tiles):.3f} s)",
            f"server's CPU time besides the render, of the render's: {unwatched:.1%} unwatched, {watched:.1%} watched,"
            f" so streaming {watched - unwatched:.1%}",
            f"{len(shares)} equal jobs at once: between {min(shares):.2f} and {max(shares):.2f} of the mean work",
        ]
    )
