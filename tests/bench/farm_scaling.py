"""A farm beyond this machine: measured costs put into a simulation of up to 1,000 workers.

    python -m tests.bench.farm_scaling measure [SCENE.xml] [--size 160 --error 0.1]    # costs of a real job, as JSON
    python -m tests.bench.farm_scaling plot                                              # deploy/farm-scaling.png

What is measured is a job on a farm of one local worker: of each stage (a round of records, or a pass) the tasks, their
CPU seconds, and the bytes of inputs, results and log; and what handling a batch costs the coordinator. The simulation
plays the same stages on W workers: batches are cut by the farm's own rule, the coordinator handles one message at a
time over one network card, log entries spread from worker to worker, and no stage begins before the one before is
complete.
"""

from __future__ import annotations

import argparse
import heapq
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fogbank.farm.costs import Costs

ROOT = Path(__file__).resolve().parents[2]
MEASURED = Path(__file__).with_name("farm_costs.json")
PLOT = ROOT / "deploy" / "farm-scaling.png"

WORKERS = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000)


@dataclass(frozen=True)
class StageCosts:
    """One stage of a job."""

    kind: str
    """"preparation", "survey" or "tile"."""

    tasks: int
    """Independent of each other."""

    task_seconds: float
    """CPU seconds of one, mean."""

    input_bytes: float
    """Of one task."""

    result_bytes: float
    """Of one task."""

    log_bytes: float
    """That every worker needs before its first task."""


@dataclass(frozen=True)
class Network:
    """What moving things costs."""

    batch_seconds: float
    """Of the coordinator and the scheduler for one batch, both ways together."""

    bytes_per_second: float = 1.25e9
    """Of a network card, 10 Gbit/s."""

    latency: float = 0.002
    """From one host to another and through Dask's queues."""


@dataclass(frozen=True)
class Simulated:
    """What became of a job."""

    seconds: float
    """Wall clock."""

    fill_seconds: float
    """Of these in rounds that make records."""

    coordinator_share: float
    """Share of the time in which the coordinator was busy."""


def simulate(stages: Sequence[StageCosts], workers: int, network: Network) -> Simulated:
    """Plays a job's stages on so many single-threaded workers."""
    now = 0.0
    fill = 0.0
    busy = 0.0
    costs = Costs()
    for stage in stages:
        began = now
        # Every worker that has the entries passes them on: a tree that doubles.
        depth = math.ceil(math.log2(workers + 1))
        now += depth * (network.latency + stage.log_bytes / network.bytes_per_second) if stage.log_bytes else 0.0
        now, used = _stage(stage, workers, network, costs, now)
        busy += used
        if stage.kind != "tile":
            fill += now - began
    return Simulated(now, fill, busy / now if now > 0.0 else 0.0)


def _stage(stage: StageCosts, workers: int, network: Network, costs: Costs, begin: float) -> tuple[float, float]:
    """When the stage ends, and how long the coordinator was busy."""
    kind: Any = stage.kind
    free = [begin] * workers
    heapq.heapify(free)
    left = stage.tasks
    coordinator = begin
    used = 0.0
    last = begin
    while left > 0:
        size = min(left, costs.batch_size(kind, slots=workers, left=left))
        left -= size
        # Handing out is on the coordinator's clock, and so is what comes back; the worker's queue of two hides latency.
        moved = size * (stage.input_bytes + stage.result_bytes) / network.bytes_per_second
        coordinator += network.batch_seconds + moved
        used += network.batch_seconds + moved
        worker = heapq.heappop(free)
        done = max(worker, coordinator + network.latency) + size * stage.task_seconds
        heapq.heappush(free, done)
        last = max(last, done)
        costs.learn(kind, size * stage.task_seconds, size)
    return max(last, coordinator) + network.latency, used


def larger(stages: Sequence[StageCosts], tasks: float, weight: float) -> list[StageCosts]:
    """A larger job of the same kind: so many times the tasks of every stage, each of so many times the work."""
    return [
        StageCosts(
            stage.kind,
            max(1, round(stage.tasks * tasks)),
            stage.task_seconds * weight,
            stage.input_bytes,
            stage.result_bytes,
            stage.log_bytes * tasks,
        )
        for stage in stages
    ]


def measure(scene: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Renders on a farm of one local worker, and on none."""
    import tempfile
    import time

    import fogbank
    import psutil
    from distributed import LocalCluster
    from fogbank import farm

    with tempfile.TemporaryDirectory() as folder:
        with fogbank.connect(data=Path(folder) / "alone", threads=1) as service:
            alone = service.load(scene).render(threads=1, **options)
            alone.wait()
        with (
            fogbank.connect(data=Path(folder) / "farm") as service,
            # A process of its own, unlike those of farm.local_cluster: what it spends is not the coordinator's.
            LocalCluster(n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster,
            farm.scheduler_client(cluster.scheduler_address) as client,
        ):
            scene_here = service.load(scene)
            server = psutil.Process(service.server_process_id)
            began, spent = time.monotonic(), _busy(server)
            job = farm.render(scene_here, client, **options)
            job.wait()
            seconds, handling = time.monotonic() - began, _busy(server) - spent
            job.join_farm()
    figures = job.farm
    assert alone.statistics is not None
    return {
        "scene": scene.name,
        "options": {name: str(value) for name, value in options.items()},
        "seconds": seconds,
        "alone_seconds": alone.statistics.render_seconds,
        "handling_seconds": handling,
        "cpu_seconds": sum(kind.cpu_seconds for kind in figures.kinds.values()),
        "batches": figures.batches,
        "stages": [
            asdict(
                StageCosts(
                    stage.kind or "preparation",
                    stage.tasks,
                    stage.cpu_seconds / max(stage.tasks, 1),
                    stage.input_bytes / max(stage.tasks, 1),
                    stage.result_bytes / max(stage.tasks, 1),
                    stage.log_bytes,
                )
            )
            for stage in figures.stages
            if stage.tasks
        ],
    }


def _busy(server: Any) -> float:  # noqa: ANN401 - psutil.Process, which has no types
    """CPU seconds of what coordinates: the client and the scheduler, which are this process, and the server."""
    import time

    spent = server.cpu_times()
    return time.process_time() + float(spent.user + spent.system)


def plot(measured: dict[str, Any], path: Path) -> list[str]:
    """Draws speed-up over workers for the measured job and larger ones; the table's lines."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    stages = [StageCosts(**stage) for stage in measured["stages"]]
    network = Network(batch_seconds=measured["handling_seconds"] / max(measured["batches"], 1))
    figure, (speed, share) = pyplot.subplots(1, 2, figsize=(11, 4.2))
    lines = ["| job | CPU | workers | wall | speed-up | in rounds of records | coordinator busy |"]
    lines.append("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for factor, weight in ((1, 1), (16, 16), (64, 256)):
        job = larger(stages, factor, weight)
        cpu = sum(stage.tasks * stage.task_seconds for stage in job)
        runs = [simulate(job, workers, network) for workers in WORKERS]
        name = f"{cpu / 3600:.2g} h" if cpu > 3600 else f"{cpu:.2g} s"
        speed.plot(WORKERS, [runs[0].seconds / run.seconds for run in runs], marker="o", label=f"{name} of CPU time")
        share.plot(WORKERS, [100 * run.fill_seconds / run.seconds for run in runs], marker="o", label=name)
        lines += [
            f"| {factor} x the tasks, {weight} x as long | {name} | {workers} | {run.seconds:.3g} s"
            f" | {runs[0].seconds / run.seconds:.3g} | {100 * run.fill_seconds / run.seconds:.0f} %"
            f" | {100 * run.coordinator_share:.0f} % |"
            for workers, run in zip(WORKERS, runs, strict=True)
            if workers in (2, 16, 128, 1000)
        ]
    speed.plot(WORKERS, WORKERS, color="grey", linestyle=":", label="ideal")
    for axes, title in ((speed, "Speed-up over one worker"), (share, "Share of the time in rounds of records, %")):
        axes.set_xscale("log")
        axes.set_xlabel("workers")
        axes.set_title(title)
        axes.grid(alpha=0.3)
        axes.legend()
    speed.set_yscale("log")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    return lines


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["measure", "plot"])
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "scenes" / "penumbra" / "penumbra.xml")
    parser.add_argument("--size", type=int, default=160, help="side of the film in pixels")
    parser.add_argument("--spp", type=int, default=48)
    parser.add_argument("--error", type=float, default=0.1)
    parser.add_argument("--out", type=Path, default=PLOT, help="picture of `plot`")
    given = parser.parse_args()
    if given.what == "measure":
        options = {"size": (given.size, given.size), "spp": given.spp, "error": given.error, "tile_size": 32}
        MEASURED.write_text(json.dumps(measure(given.scene, options), indent=1) + "\n")
    print("\n".join(plot(json.loads(MEASURED.read_text()), given.out)))


if __name__ == "__main__":
    main()
