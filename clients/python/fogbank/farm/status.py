"""How a farm is doing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from distributed import Client

from fogbank.farm.parcels import WorkerReport
from fogbank.farm.plugin import worker_report
from fogbank.farm.published import published_jobs


@dataclass(frozen=True)
class WorkerStatus:
    """One worker."""

    address: str
    """Where it listens."""

    name: str
    """As it was started."""

    threads: int
    """Batches that it performs at once."""

    memory_bytes: int
    """Most memory of its process and of its engine, each; 0 for no limit."""

    engine: WorkerReport | None
    """Its engine; None for a worker that was never used."""


@dataclass(frozen=True)
class FarmStatus:
    """A cluster, and what it does for Fogbank."""

    scheduler: str
    """Address of the scheduler."""

    dashboard: str
    """URL of Dask's dashboard; empty without one."""

    workers: list[WorkerStatus]
    """All workers."""

    jobs: dict[str, dict[str, Any]]
    """What jobs of the last hour have told: begun, seen (seconds since 1970), ended, farm (`FarmStatistics`)."""


def farm_status(client: Client) -> FarmStatus:
    """How the farm of a scheduler is doing."""
    information = client.scheduler_info(n_workers=-1)
    reports = client.run(worker_report, on_error="ignore")
    workers = [
        WorkerStatus(
            address=str(address),
            name=str(worker["name"]),
            threads=int(worker["nthreads"]),
            memory_bytes=int(worker["memory_limit"] or 0),
            engine=reports.get(address),
        )
        for address, worker in information["workers"].items()
    ]
    return FarmStatus(
        scheduler=str(information["address"]),
        dashboard=client.dashboard_link or "",
        workers=workers,
        jobs=published_jobs(client),
    )
