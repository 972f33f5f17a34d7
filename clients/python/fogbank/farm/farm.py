"""Rendering on the workers of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Self, TypedDict, Unpack

from distributed import Client
from distributed.deploy.cluster import Cluster

from fogbank._generated.v1 import render_pb2, server_pb2
from fogbank.cache import FillProgress
from fogbank.camera import CameraLike
from fogbank.capabilities import Capabilities
from fogbank.farm.coordinator import Coordinator
from fogbank.farm.costs import Costs
from fogbank.farm.crew import Crew
from fogbank.farm.farm_job import FarmJob
from fogbank.farm.plugin import FarmPlugin
from fogbank.farm.scene_parcel import SceneParcel
from fogbank.job_report import Priority
from fogbank.scene import Scene
from fogbank.settings import RenderOptions

# Tiles that a pass should have for each thread, so that all end at about the same time; and the side of a tile below
# which handing it around costs more than that.
_TILES_PER_SLOT = 8
_SMALLEST_TILE = 16


class WorkerLimits(TypedDict, total=False):
    """Of each worker."""

    worker_threads: int | None
    """Render threads; the worker's own number when None."""

    worker_memory_bytes: int | None
    """Most memory of its server; the worker's own limit when None."""


class Farm:
    """The workers of a Dask cluster for several jobs, such as the frames of a sweep: what one of them found out about
    workers and costs, and the scene that it sent, serve the next.

    The server that has a scene coordinates and traces nothing; pictures are, bit for bit, those that it would make by
    itself. Jobs may run side by side, and have ended before the farm is closed. Not thread-safe, but for its jobs.
    """

    def __init__(
        self,
        cluster: Client | Cluster,
        *,
        worker_threads: int | None = None,
        worker_memory_bytes: int | None = None,
    ) -> None:
        """Gets the workers ready; their servers start with the first batch.

        Args:
            cluster: a `dask.distributed.Client`, or a cluster, which gets a client.
            worker_threads: see `WorkerLimits`.
            worker_memory_bytes: see `WorkerLimits`.
        """
        self._crew = Crew(cluster, FarmPlugin(threads=worker_threads, memory_bytes=worker_memory_bytes))
        self._parcels: dict[str, SceneParcel] = {}
        self._costs: dict[bytes, Costs] = {}

    def __enter__(self) -> Self:
        """As it is."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Closes it."""
        self.close()

    def close(self) -> None:
        """Lets go of the cluster; harmless when repeated."""
        self._crew.close()

    def render(
        self,
        scene: Scene,
        *,
        request_id: str | None = None,
        priority: Priority = "normal",
        **options: Unpack[RenderOptions],
    ) -> FarmJob:
        """Renders a scene on all workers, and returns at once.

        Where options leave open when to end (`time_budget`), that depends on the machines, as always.

        Args:
            scene: loaded with `Service.load`, whose files are sent to workers that lack them.
            request_id: as for `Scene.render`.
            priority: as for `Scene.render`.
            options: as for `Scene.render`.

        Raises what `Scene.render` does, and FarmError for a scene whose files are not on this machine.
        """
        return self._start(scene, options, request_id=request_id, priority=priority)

    def fill_events(
        self, scene: Scene, cameras: Sequence[CameraLike] = (), **options: Unpack[RenderOptions]
    ) -> Iterator[FillProgress]:
        """Makes the records that pictures from these cameras need on the workers, and yields how far it is.

        They are those of `SceneCache.fill_events`, record for record; the last report names the epoch that has them
        all. Dropping the generator ends the fill; the records made until then stay.

        Args:
            scene: as for `render`.
            cameras: in the order in which records are made for them; empty for the scene's own alone.
            options: as of the renders that are going to use the records, but for `time_budget`.

        Raises as `render`, and JobFailedError or JobCancelledError when it ends early.
        """
        todo: Sequence[CameraLike | None] = cameras or [None]
        before: FillProgress | None = None
        for done, camera in enumerate(todo):
            chosen = RenderOptions(**options)
            if camera is not None:
                chosen["camera"] = camera
            budget = options.get("records")
            if budget is not None and before is not None:
                chosen["records"] = max(0, budget - before.records_new)
            job = self._start(scene, chosen, fill_only=True)
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

    def _start(
        self,
        scene: Scene,
        options: RenderOptions,
        *,
        request_id: str | None = None,
        priority: Priority = "normal",
        fill_only: bool = False,
        on_end: Callable[[], None] = lambda: None,
    ) -> FarmJob:
        parcel = self._parcels.get(scene.name)
        if parcel is None:
            parcel = self._parcels[scene.name] = SceneParcel(scene)
        connection = scene.connection
        capabilities = connection.call(lambda stubs: stubs.server.GetCapabilities, server_pb2.GetCapabilitiesRequest())
        if options.get("tile_size") is None:
            options["tile_size"] = _tile_size(scene, options, self._crew.slots, Capabilities.from_message(capabilities))
        message = scene.create_job(options, request_id=request_id, priority=priority, leased=True, fill_only=fill_only)
        costs = self._costs.setdefault(_kind_of_job(message), Costs())
        coordinator = Coordinator(connection, message, parcel, self._crew, costs=costs, build_id=capabilities.build_id)
        return FarmJob(connection, message, coordinator, self._crew, on_end)


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
    """One picture by a farm of its own: `Farm(cluster, ...).render(scene, ...)`."""
    farm = Farm(cluster, worker_threads=worker_threads, worker_memory_bytes=worker_memory_bytes)
    return farm._start(scene, options, request_id=request_id, priority=priority, on_end=farm.close)


def fill_events(
    scene: Scene,
    cluster: Client | Cluster,
    cameras: Sequence[CameraLike] = (),
    *,
    worker_threads: int | None = None,
    worker_memory_bytes: int | None = None,
    **options: Unpack[RenderOptions],
) -> Iterator[FillProgress]:
    """Records by a farm of its own: `Farm(cluster, ...).fill_events(scene, cameras, ...)`."""
    with Farm(cluster, worker_threads=worker_threads, worker_memory_bytes=worker_memory_bytes) as farm:
        yield from farm.fill_events(scene, cameras, **options)


def _kind_of_job(message: render_pb2.Job) -> bytes:
    """The same for jobs whose tasks cost about as much: those of a sweep differ in camera and records alone."""
    settings = render_pb2.RenderSettings()
    settings.CopyFrom(message.settings)
    settings.ClearField("camera")
    settings.ClearField("epoch")
    return message.scene.encode() + settings.SerializeToString(deterministic=True)


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
