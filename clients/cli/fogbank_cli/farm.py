"""`fogbank farm`: rendering on many machines."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click
from fogbank import RenderOptions

from fogbank_cli.farm_options import (
    ClusterChoice,
    cluster_options,
    open_scheduler,
    scheduler_options,
)
from fogbank_cli.image_output import exposure_option, follow_and_save, watch_tev_option
from fogbank_cli.output import Output, duration, quantity
from fogbank_cli.parameter_types import ImagePathType
from fogbank_cli.render import load_scene
from fogbank_cli.render_options import picture_options
from fogbank_cli.session import Session, json_option, loading_options, openjd_option, pass_session
from fogbank_cli.sweep_frames import SweepChoice, render_sweep, sweep_options

if TYPE_CHECKING:
    from distributed import Client
    from fogbank.farm import FarmJob, WorkerStatus


@click.group()
def farm() -> None:
    """Render on the workers of a Dask cluster. Pictures are those of one machine, bit for bit.

    This command is the go-between; the server that it starts, or that --server names, coordinates and keeps records.
    """


@farm.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "paths", type=ImagePathType(), multiple=True, required=True, help=".exr or .png; may be repeated."
)
@cluster_options
@picture_options
@loading_options
@exposure_option
@watch_tev_option
@openjd_option
@json_option
@pass_session
def render(
    session: Session,
    /,
    scene: Path,
    paths: tuple[Path, ...],
    cluster: ClusterChoice,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    exposure: float,
    watch_tev: tuple[str, int] | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Render SCENE on a farm, and write the image. Ctrl-C cancels the render."""
    output = session.output
    with cluster.open() as client, session.connect() as service:
        from fogbank import farm

        report_cluster(client, output)
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        job = farm.render(
            loaded,
            client,
            **cluster.worker_limits,
            **options,
        )
        output.event("job", job=job.name, settings=job.settings)
        try:
            follow_and_save(
                job,
                output,
                paths,
                tev_address=watch_tev,
                exposure=exposure,
                on_interrupt="cancel",
                load_seconds=loaded.load_seconds,
            )
        finally:
            job.join_farm()
            report_farm(job, output)


@farm.command()
@sweep_options
@cluster_options
@openjd_option
@json_option
@pass_session
def sweep(
    session: Session,
    /,
    choice: SweepChoice,
    cluster: ClusterChoice,
    **options: Unpack[RenderOptions],
) -> None:
    """Render SCENE along a camera path on a farm: the frames of `fogbank sweep`, bit for bit, records included."""
    output = session.output
    with cluster.open() as client, session.connect() as service:
        from fogbank import farm

        report_cluster(client, output)
        loaded = choice.load(service, output)
        with farm.Farm(client, **cluster.worker_limits) as workers:
            render_sweep(
                choice,
                loaded,
                service,
                output,
                options,
                start=lambda frame: workers.render(loaded, **frame),
                fill_events=lambda cameras, **fill: workers.fill_events(loaded, cameras, **fill),
            )


@farm.command()
@scheduler_options
@json_option
@pass_session
def status(
    session: Session,
    /,
    scheduler: str | None,
    dask_ca: Path | None,
    dask_certificate: Path | None,
    dask_key: Path | None,
) -> None:
    """Show workers, and what jobs of the last hour did on them: tiles, records, bytes, stragglers, losses."""
    if scheduler is None:
        raise click.UsageError("give --scheduler, or FOGBANK_SCHEDULER")
    output = session.output
    with open_scheduler(scheduler, dask_ca, dask_certificate, dask_key) as client:
        from fogbank import farm

        found = farm.farm_status(client)
    output.event("farm", scheduler=found.scheduler, dashboard=found.dashboard, workers=found.workers, jobs=found.jobs)
    output.text(f"{found.scheduler}, dashboard {found.dashboard or 'off'}")
    output.table(
        ("WORKER", "THREADS", "MEMORY", "SERVER", "BATCHES", "TASKS", "CPU", "RUNNING"),
        [_worker_row(worker) for worker in found.workers],
    )
    if found.jobs:
        output.text("")
        output.table(
            (
                "JOB",
                "SINCE",
                "STATE",
                "TILES",
                "OTHER TASKS",
                "BY SERVER",
                "CPU",
                "RECORDS",
                "MOVED",
                "STRAGGLERS",
                "LOST",
                "POISONED",
            ),
            [_job_row(name, job) for name, job in found.jobs.items()],
        )


def report_cluster(client: Client, output: Output) -> None:
    """Says where the work goes."""
    workers = client.nthreads()
    output.event(
        "cluster", scheduler=client.scheduler_info()["address"], dashboard=client.dashboard_link, workers=workers
    )
    if not output.as_json:
        where = f", dashboard {client.dashboard_link}" if client.dashboard_link else ""
        output.note(f"{len(workers)} workers of {sum(workers.values())} threads{where}")


def report_farm(job: FarmJob, output: Output) -> None:
    """Says what the farm did."""
    farm = job.farm
    output.event("farm", job=job.name, **farm.as_dict())
    moved = farm.log_bytes + sum(kind.input_bytes + kind.result_bytes for kind in farm.kinds.values())
    parts = [f"{len(farm.workers)} workers", f"{farm.batches} batches", f"{quantity(moved, 'B')} of tasks and records"]
    parts += [
        f"{count} {what}"
        for count, what in (
            (farm.own_tasks, "tasks shorter than a trip to a worker, done by the server itself"),
            (farm.stragglers, "given to a second worker"),
            (farm.lost, "lost and repeated"),
            (farm.poisoned, "poisoned"),
        )
        if count
    ]
    output.text(f"farm: {', '.join(parts)}")


def _worker_row(worker: WorkerStatus) -> tuple[str, ...]:
    memory = quantity(worker.memory_bytes, "B") if worker.memory_bytes else "no limit"
    engine = worker.engine
    if engine is None or not engine.build_id:
        return worker.address, str(worker.threads), memory, "not started", "", "", "", ""
    return (
        worker.address,
        str(worker.threads),
        memory,
        engine.build_id[:12],
        str(engine.batches),
        str(engine.tasks),
        duration(engine.task_seconds),
        str(len(engine.running)),
    )


def _job_row(name: str, job: dict[str, Any]) -> tuple[str, ...]:
    farm = job["farm"]
    kinds = farm["kinds"]
    tiles = kinds.get("tile", {}).get("tasks", 0)
    moved = farm["log_bytes"] + sum(kind["input_bytes"] + kind["result_bytes"] for kind in kinds.values())
    stale = time.time() - job["seen"] > 10.0
    return (
        name,
        time.strftime("%H:%M:%S", time.localtime(job["begun"])),
        "ended" if job["ended"] else "silent" if stale else "running",
        str(tiles),
        str(sum(kind["tasks"] for kind in kinds.values()) - tiles),
        str(farm.get("own_tasks", 0)),
        duration(sum(kind["cpu_seconds"] for kind in kinds.values())),
        str(farm["records"]),
        quantity(moved, "B"),
        str(farm["stragglers"]),
        str(farm["lost"]),
        str(farm["poisoned"]),
    )
