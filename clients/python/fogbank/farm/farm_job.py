"""Jobs that a farm performs."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from typing import TypedDict, Unpack

from distributed import Client
from distributed.deploy.cluster import Cluster

from fogbank._generated.v1 import render_pb2, server_pb2
from fogbank.cache import FillProgress
from fogbank.camera import CameraLike
from fogbank.capabilities import Capabilities
from fogbank.channel import Connection
from fogbank.errors import FogbankError
from fogbank.farm.coordinator import Coordinator
from fogbank.farm.crew import Crew
from fogbank.farm.plugin import FarmPlugin
from fogbank.farm.published import Publisher
from fogbank.farm.scene_parcel import SceneParcel
from fogbank.farm.statistics import FarmStatistics
from fogbank.job import Job
from fogbank.job_report import Priority
from fogbank.scene import Scene
from fogbank.settings import RenderOptions

# Tiles that a pass should have for each thread, so that all end at about the same time; and the side of a tile below
# which handing it around costs more than that.
_TILES_PER_SLOT = 8
_SMALLEST_TILE = 16


class FarmJob(Job):
    """A job whose tasks a cluster performs: to all who look at it a job like any other.

    It needs this program as the go-between: while nobody leases its tasks it waits.
    """

    def __init__(self, connection: Connection, message: render_pb2.Job, coordinator: Coordinator, crew: Crew) -> None:
        """Made by `fogbank.farm.render`, not by users. Begins at once, in a thread of its own."""
        super().__init__(connection, message)
        self._coordinator = coordinator
        self._crew = crew
        self._failure: FogbankError | None = None
        self._thread = threading.Thread(target=self._run, name=f"fogbank-farm {self.name}", daemon=True)
        self._thread.start()

    @property
    def farm(self) -> FarmStatistics:
        """What the farm did for it so far."""
        return self._coordinator.statistics

    @property
    def error(self) -> FogbankError | None:
        """Why it failed or was cancelled: FarmError where that was the farm's doing; None for any other state."""
        if self._failure is not None and self.ended:
            return self._failure
        return super().error

    def join_farm(self, timeout: float | None = None) -> None:
        """Waits until the farm has let go of the job, at most `timeout` seconds: a moment after its end."""
        self._thread.join(timeout)

    def _run(self) -> None:
        publisher = Publisher(self._crew, self.name, self._coordinator.statistics)
        try:
            publisher.start()
            self._coordinator.run()
        except FogbankError as error:
            self._failure = error
        except Exception as error:
            self._failure = FogbankError(f"the farm of {self.name} failed: {type(error).__name__}: {error}")
        finally:
            if self._failure is not None:
                self._cancel_quietly()
            publisher.stop()
            self._crew.close()

    def _cancel_quietly(self) -> None:
        try:
            self._connection.call(
                lambda stubs: stubs.render.CancelJob, render_pb2.CancelJobRequest(name=self.name), timeout=10.0
            )
        except FogbankError:
            # The server is gone as well, which is what the job's watchers hear.
            return


class WorkerLimits(TypedDict, total=False):
    """Of each worker."""

    worker_threads: int | None
    """Render threads; the worker's own number when None."""

    worker_memory_bytes: int | None
    """Most memory of its server; the worker's own limit when None."""


def render(
    scene: Scene,
    cluster: Client | Cluster,
    *,
    worker_threads: int | None = None,
    worker_memory_bytes: int | None = None,
    request_id: str | None = None,
    priority: Priority = "normal",
    **options: Unpack[RenderOptions],
) -> FarmJob:
    """Renders a scene on all workers of a Dask cluster, and returns at once.

    The server that has the scene coordinates and traces nothing; the picture is, bit for bit, the one that it would
    make by itself. Where options leave open when to end (`time_budget`), that depends on the machines, as always.

    Args:
        scene: loaded with `Service.load`, whose files are sent to workers that lack them.
        cluster: a `dask.distributed.Client`, or a cluster, which gets a client.
        worker_threads: see `WorkerLimits`.
        worker_memory_bytes: see `WorkerLimits`.
        request_id: as for `Scene.render`.
        priority: as for `Scene.render`.
        options: as for `Scene.render`.

    Raises what `Scene.render` does, and FarmError for a scene whose files are not on this machine.
    """
    limits = WorkerLimits(worker_threads=worker_threads, worker_memory_bytes=worker_memory_bytes)
    return _start(scene, cluster, limits, options, request_id=request_id, priority=priority)


def fill_events(
    scene: Scene,
    cluster: Client | Cluster,
    cameras: Sequence[CameraLike] = (),
    *,
    worker_threads: int | None = None,
    worker_memory_bytes: int | None = None,
    **options: Unpack[RenderOptions],
) -> Iterator[FillProgress]:
    """Makes the records that pictures from these cameras need on the workers, and yields how far it is.

    They are those of `SceneCache.fill_events`, record for record; the last report names the epoch that has them all.
    Dropping the generator ends the fill; the records made until then stay.

    Args:
        scene: as for `render`.
        cluster: as for `render`.
        cameras: in the order in which records are made for them; empty for the scene's own alone.
        worker_threads: see `WorkerLimits`.
        worker_memory_bytes: see `WorkerLimits`.
        options: as of the renders that are going to use the records, but for `time_budget`.

    Raises as `render`, and JobFailedError or JobCancelledError when it ends early.
    """
    limits = WorkerLimits(worker_threads=worker_threads, worker_memory_bytes=worker_memory_bytes)
    todo: Sequence[CameraLike | None] = cameras or [None]
    before: FillProgress | None = None
    for done, camera in enumerate(todo):
        chosen = RenderOptions(**options)
        if camera is not None:
            chosen["camera"] = camera
        budget = options.get("records")
        if budget is not None and before is not None:
            chosen["records"] = max(0, budget - before.records_new)
        job = _start(scene, cluster, limits, chosen, fill_only=True)
        try:
            for _ in job.events(tiles=False):
                if not job.ended:
                    yield _fill_progress(job, before, done, len(todo))
        finally:
            if not job.ended:
                job.cancel()
            job.join_farm()
        job.wait()
        if job.error is not None:
            raise job.error
        before = _fill_progress(job, before, done, len(todo))
        yield before


def _fill_progress(job: FarmJob, before: FillProgress | None, cameras_done: int, cameras_total: int) -> FillProgress:
    """How far the fill of a camera is, with that of all before."""
    result = job.statistics
    now = job.progress if result is None else result
    seconds = job.progress.elapsed_seconds if result is None else result.render_seconds
    cameras_done += 0 if result is None else 1
    return FillProgress(
        cameras_done=cameras_done,
        cameras_total=cameras_total,
        fraction=cameras_done / cameras_total,
        records_reused=now.records_reused if before is None else before.records_reused,
        records_new=now.records_new + (0 if before is None else before.records_new),
        epoch=now.epoch,
        rays=now.rays + (0 if before is None else before.rays),
        elapsed_seconds=seconds + (0.0 if before is None else before.elapsed_seconds),
        done=cameras_done == cameras_total,
    )


def _start(
    scene: Scene,
    cluster: Client | Cluster,
    limits: WorkerLimits,
    options: RenderOptions,
    *,
    request_id: str | None = None,
    priority: Priority = "normal",
    fill_only: bool = False,
) -> FarmJob:
    client = cluster if isinstance(cluster, Client) else Client(cluster, set_as_default=False)
    parcel = SceneParcel(scene)
    crew = Crew(client, FarmPlugin(threads=limits["worker_threads"], memory_bytes=limits["worker_memory_bytes"]))
    connection = scene.connection
    capabilities = connection.call(lambda stubs: stubs.server.GetCapabilities, server_pb2.GetCapabilitiesRequest())
    if options.get("tile_size") is None:
        options["tile_size"] = _tile_size(scene, options, crew.slots, Capabilities.from_message(capabilities))
    message = scene.create_job(options, request_id=request_id, priority=priority, leased=True, fill_only=fill_only)
    coordinator = Coordinator(connection, message, parcel, crew, build_id=capabilities.build_id)
    return FarmJob(connection, message, coordinator, crew)


def _tile_size(scene: Scene, options: RenderOptions, slots: int, capabilities: Capabilities) -> int:
    """Side of the tiles in pixels, which never changes a picture: smaller ones for more workers."""
    limits = {name: int(limit.value) for name, limit in capabilities.limits.items()}
    width, height = options.get("size") or scene.defaults.size
    crop = options.get("crop")
    pixels = crop[2] * crop[3] if crop is not None else (width or height or 1) * (height or width or 1)
    side = limits["default_tile_size"]
    while side > max(_SMALLEST_TILE, limits["min_tile_size"]) and pixels < _TILES_PER_SLOT * slots * side * side:
        side //= 2
    return side
