"""What runs on Dask's workers: the plugin that keeps an engine, and the functions that use it."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

from distributed import Worker, WorkerPlugin, get_worker

from fogbank.farm.engine import Engine
from fogbank.farm.parcels import Batch, BatchResult, FilePiece, LogSegment, WorkerReport

NAME = "fogbank-farm"


class FarmPlugin(WorkerPlugin):
    """Keeps one engine for each worker, as long as the worker lives; a worker that is started again gets another."""

    name = NAME
    # Registered by every job: the engine that there is stays.
    idempotent = True

    def __init__(self, *, threads: int | None = None, memory_bytes: int | None = None) -> None:
        """Limits of each worker.

        Args:
            threads: render threads; None for the worker's own number.
            memory_bytes: memory of the server; None for the worker's own limit.
        """
        self._threads = threads
        self._memory_bytes = memory_bytes
        self.engine: Engine | None = None

    def setup(self, worker: Worker) -> None:
        """Makes the engine; its server starts with the first batch, so that a worker without one joins the cluster."""
        self.engine = Engine(
            worker.address,
            # Beside the worker's own folder, which goes with it.
            Path(worker.local_directory).parent / "fogbank",
            threads=self._threads or worker.state.nthreads,
            memory_bytes=self._memory_bytes or worker.memory_manager.memory_limit,
        )

    def teardown(self, worker: Worker) -> None:
        """Ends the engine."""
        if self.engine is not None:
            self.engine.close()


def hold(parcel: bytes | LogSegment | FilePiece) -> object:
    """Puts a parcel into a worker's memory, where others fetch it; Dask repeats this when that worker is lost."""
    return parcel


def perform(batch: Batch, log: Sequence[LogSegment], files: Sequence[FilePiece]) -> BatchResult:
    """Performs a batch on the worker that this runs on."""
    return _engine(get_worker()).perform(batch, log, files)


async def cancel_batches(numbers: Sequence[str], dask_worker: Worker) -> None:
    """Stops batches on a worker, whatever its threads do."""
    await asyncio.to_thread(_engine(dask_worker).cancel, numbers)


async def close_replicas(log: str, dask_worker: Worker) -> None:
    """Closes the replicas of a job on a worker."""
    await asyncio.to_thread(_engine(dask_worker).close_replica, log)


def worker_report(dask_worker: Worker) -> WorkerReport | None:
    """How a worker's engine is doing; None for a worker that was never used."""
    plugin = dask_worker.plugins.get(NAME)
    return plugin.engine.report() if isinstance(plugin, FarmPlugin) and plugin.engine is not None else None


def _engine(worker: Worker) -> Engine:
    plugin = worker.plugins.get(NAME)
    if not isinstance(plugin, FarmPlugin) or plugin.engine is None:
        raise RuntimeError(f"{worker.address} has not got the plugin {NAME}")
    return plugin.engine
