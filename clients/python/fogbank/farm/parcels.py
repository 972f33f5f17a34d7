"""What travels between coordinator and workers.

Messages of the wire contract travel serialised: their bytes are all that Dask's own pickling has to carry.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

TaskKind: TypeAlias = Literal["preparation", "survey", "tile"]


@dataclass(frozen=True)
class JobIdentity:
    """What a worker needs to make a replica of a job."""

    job: str
    """"jobs/{id}" on the coordinator."""

    scene: str
    """"scenes/{fingerprint}", the same name everywhere."""

    manifest: bytes
    """SceneManifest of its files."""

    settings: bytes
    """RenderSettings, the effective ones."""

    log: str
    """Id of the job's log."""

    build_id: str
    """Of the coordinator."""


@dataclass(frozen=True)
class Batch:
    """Tasks that a worker performs together."""

    number: str
    """Unique among all batches."""

    identity: JobIdentity
    """The job."""

    kind: TaskKind
    """What its tasks do."""

    tasks: tuple[bytes, ...]
    """LeasedTask messages, of one stage."""

    log_length: int
    """Log entries that a replica must have replayed."""


@dataclass(frozen=True)
class LogSegment:
    """Some entries of a job's log that follow each other."""

    first: int
    """Index of the first one."""

    entries: tuple[bytes, ...]
    """JobLogEntry messages; together small enough for one request."""

    @property
    def end(self) -> int:
        """Index after the last one."""
        return self.first + len(self.entries)

    @property
    def size(self) -> int:
        """Bytes of its entries."""
        return sum(map(len, self.entries))


@dataclass(frozen=True)
class FilePiece:
    """A piece of a scene's file."""

    sha256: str
    """Of the whole file, 64 lower-case hexadecimal digits."""

    size: int
    """Of the whole file in bytes."""

    offset: int
    """Where the piece begins."""

    data: bytes
    """Its bytes."""


@dataclass(frozen=True)
class Refusal:
    """Why a worker did not perform a batch."""

    reason: str
    """Stable word, such as "BUILD_MISMATCH"."""

    message: str
    """For people."""


@dataclass(frozen=True)
class BatchResult:
    """What came of a batch on one worker."""

    worker: str
    """Address of the worker."""

    parts: tuple[bytes, ...] = ()
    """TaskResultPart messages, those of one result in order; of tasks that were dropped there are none."""

    log_length: int = 0
    """Log entries that the worker's replica has replayed."""

    lacks: Literal["", "scene", "log"] = ""
    """What the worker would have needed besides: the scene's files, or log entries from `log_length` on."""

    refusal: Refusal | None = None
    """Set when it was not performed for another reason."""

    seconds: float = 0.0
    """Wall-clock seconds on the worker."""


@dataclass
class WorkerReport:
    """How a worker's engine is doing."""

    build_id: str = ""
    """Of its server; empty before it runs."""

    threads: int = 0
    """Render threads."""

    batches: int = 0
    """Performed since it was started."""

    tasks: int = 0
    """Performed since it was started."""

    task_seconds: float = 0.0
    """CPU seconds of these."""

    result_bytes: int = 0
    """Of their results."""

    log_bytes: int = 0
    """Of log entries that were replayed."""

    scene_bytes: int = 0
    """Of scene files that were uploaded to it."""

    server_starts: int = 0
    """How often its server was started."""

    running: list[str] = field(default_factory=list)
    """Numbers of the batches that are being performed."""
