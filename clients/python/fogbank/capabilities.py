"""What a server is and how busy it is."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from fogbank._generated.v1 import server_pb2


@dataclass(frozen=True)
class Limit:
    """A number that the server enforces or promises."""

    value: float
    """The number."""

    unit: str
    """"bytes", "seconds", "pixels" or "count"."""

    description: str
    """What it limits."""


@dataclass(frozen=True)
class Capabilities:
    """What a server is and can do; the same for as long as it runs."""

    version: str
    """Version of Fogbank."""

    build_id: str
    """Two servers with the same build id give the same pixels."""

    integrators: dict[str, str]
    """What `RenderOptions.integrator` takes, each with a description."""

    cached_integrators: list[str]
    """Those of `integrators` that read and fill the scene's radiance cache."""

    probe_methods: dict[str, str]
    """What `ProbeOptions.method` takes, each with a description."""

    limits: dict[str, Limit]
    """By name."""

    scene_plugins: dict[str, list[str]]
    """Plugins that the scene loader reads, by kind ("shape", "bsdf", ...)."""

    channel_arguments: dict[str, int]
    """gRPC channel arguments that clients are to use; this package does."""

    scene_root: bool
    """True when `Service.load_server_file` works."""

    @classmethod
    def from_message(cls, message: server_pb2.GetCapabilitiesResponse) -> Capabilities:
        """The capabilities of a wire message."""
        return cls(
            version=message.version,
            build_id=message.build_id,
            integrators={integrator.name: integrator.description for integrator in message.integrators},
            cached_integrators=[item.name for item in message.integrators if item.cached],
            probe_methods={method.name: method.description for method in message.probe_methods},
            limits={limit.name: Limit(limit.value, limit.unit, limit.description) for limit in message.limits},
            scene_plugins={plugins.kind: list(plugins.names) for plugins in message.scene_plugins},
            channel_arguments={argument.name: argument.value for argument in message.channel_arguments},
            scene_root=message.scene_root,
        )


@dataclass(frozen=True)
class QuotaUse:
    """How much of one quota is used."""

    unit: str
    """count, bytes or seconds."""

    limit: float
    """Most that may be used."""

    used: float
    """What is used."""

    window_seconds: float
    """What CPU seconds are counted over; 0 for the other quotas."""

    retry_after_seconds: float
    """When to ask again; 0 while the quota is not exhausted."""


@dataclass(frozen=True)
class ServerStatus:
    """How busy a server is."""

    start_time: datetime
    """When it was started, UTC."""

    uptime_seconds: float
    """Seconds since then."""

    jobs: dict[str, int]
    """Number of jobs by state ("queued", "running", "paused", "succeeded", "failed", "cancelled")."""

    scenes: int
    """Scenes that are known."""

    resident_scenes: int
    """Scenes in memory."""

    worker_threads: int
    """Worker threads."""

    busy_threads: int
    """Worker threads that render at this moment."""

    memory_bytes: int
    """Resident memory of the server's process."""

    scene_memory_bytes: int
    """Memory of the loaded scenes."""

    rays_per_second: float
    """All jobs, over the last seconds."""

    rays: int
    """Rays of jobs since the start."""

    watchers: int
    """Clients that are following a job."""

    probes: int
    """Open streams of points."""

    cache_memory_bytes: int
    """Memory of the loaded caches."""

    fills: int
    """Caches that are being filled without a picture."""

    tiles: int
    """Tiles rendered since the start, those of every pass counted."""

    film_memory_bytes: int
    """Memory planned for the films of jobs."""

    memory_budget_bytes: int
    """What scenes, caches and films may take together."""

    disk_free_bytes: int
    """Space left on the disk of the data directory."""

    errors: dict[str, int]
    """Jobs that failed since the start, by reason."""

    tenant: str | None
    """Whom the server takes this client for; None where it asks nobody."""

    quotas: dict[str, QuotaUse]
    """This client's quotas by name, those that are set."""

    reader_confinement: dict[str, str | None]
    """Layers ("rlimits", "seccomp", "landlock") that confine the processes which read scene files: None where one is in
    force, else why it isn't. Empty until the first such process has been started, a moment after the server."""

    @classmethod
    def from_message(cls, message: server_pb2.GetServerStatusResponse) -> ServerStatus:
        """The status of a wire message."""
        jobs = message.jobs
        return cls(
            start_time=message.start_time.ToDatetime(UTC),
            uptime_seconds=message.uptime_seconds,
            jobs={
                "queued": jobs.queued,
                "running": jobs.running,
                "paused": jobs.paused,
                "succeeded": jobs.succeeded,
                "failed": jobs.failed,
                "cancelled": jobs.cancelled,
            },
            scenes=message.scenes,
            resident_scenes=message.resident_scenes,
            worker_threads=message.worker_threads,
            busy_threads=message.busy_threads,
            memory_bytes=message.memory_bytes,
            scene_memory_bytes=message.scene_memory_bytes,
            rays_per_second=message.rays_per_second,
            rays=message.rays,
            watchers=message.watchers,
            probes=message.probes,
            cache_memory_bytes=message.cache_memory_bytes,
            fills=message.fills,
            tiles=message.tiles,
            film_memory_bytes=message.film_memory_bytes,
            memory_budget_bytes=message.memory_budget_bytes,
            disk_free_bytes=message.disk_free_bytes,
            errors={error.reason: error.count for error in message.errors},
            tenant=message.tenant or None,
            quotas={
                quota.name: QuotaUse(
                    unit=quota.unit,
                    limit=quota.limit,
                    used=quota.used,
                    window_seconds=quota.window_seconds,
                    retry_after_seconds=quota.retry_after_seconds,
                )
                for quota in message.quotas
            },
            reader_confinement={
                layer.name: None if layer.in_force else layer.problem for layer in message.reader_confinement
            },
        )
