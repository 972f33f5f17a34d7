"""Radiance caches of a server: what is in them, filling them, moving them between machines, their upkeep."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Unpack

import grpc

from fogbank._generated.v1 import cache_pb2
from fogbank.atomic_file import write_atomically
from fogbank.cache_view import CacheComponent, CacheView, view_cache
from fogbank.camera import CameraLike, camera_message
from fogbank.channel import Connection
from fogbank.download import FileChunk, download
from fogbank.errors import DataLossError, FogbankError, UnavailableError
from fogbank.retry import Backoff
from fogbank.settings import RenderOptions, settings_message
from fogbank.tracing import trace_metadata
from fogbank.upload import ProgressSink, upload_file

# Of a file that is hashed at once.
_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class CacheStatistics:
    """What a cache holds."""

    records: int
    """Records."""

    components: list[CacheComponent]
    """The same by component; empty in listings."""

    epoch: int
    """Number of times that records were added."""

    disk_bytes: int
    """Size on the server's disk."""

    memory_bytes: int
    """Size in the server's memory; 0 while it is not loaded."""

    segments: int
    """Files that it consists of."""

    last_use_time: datetime
    """When it was last read or added to, UTC."""

    @classmethod
    def from_message(cls, message: cache_pb2.Cache) -> CacheStatistics:
        """The statistics of a wire message."""
        return cls(
            records=message.records,
            components=[CacheComponent.from_message(component) for component in message.components],
            epoch=message.epoch,
            disk_bytes=message.disk_bytes,
            memory_bytes=message.memory_bytes,
            segments=message.segments,
            last_use_time=message.last_use_time.ToDatetime(UTC),
        )


@dataclass(frozen=True)
class FillProgress:
    """How far a fill is."""

    cameras_done: int
    """Cameras that are done."""

    cameras_total: int
    """Cameras in all."""

    fraction: float
    """Share of the work that is done, about; 0 to 1."""

    records_reused: int
    """Records in the cache when the fill began."""

    records_new: int
    """Records that it has made."""

    epoch: int
    """The cache's epoch; of the last report what `RenderOptions.epoch` takes."""

    rays: int
    """Rays traced."""

    elapsed_seconds: float
    """Since the first ray."""

    done: bool
    """True in the last report."""

    @classmethod
    def from_message(cls, message: cache_pb2.FillCacheResponse) -> FillProgress:
        """The progress of a wire message."""
        return cls(
            cameras_done=message.cameras_done,
            cameras_total=message.cameras_total,
            fraction=message.fraction,
            records_reused=message.records_reused,
            records_new=message.records_new,
            epoch=message.epoch,
            rays=message.rays,
            elapsed_seconds=message.elapsed_seconds,
            done=message.done,
        )


@dataclass(frozen=True)
class VerifyReport:
    """What checking a cache found."""

    records: int
    """Records that are whole."""

    segments: int
    """Files that were checked."""

    damaged_segments: int
    """Files that were damaged and set aside; what they held is made again when it is needed."""

    bytes: int
    """Bytes that were checked."""


@dataclass(frozen=True)
class GarbageReport:
    """What collecting garbage freed."""

    removed: list[str]
    """Names of the caches that were removed."""

    bytes_before: int
    """Bytes that all caches took on the disk."""

    bytes_after: int
    """Bytes that they take now."""


@dataclass(frozen=True)
class ImportReport:
    """What an import brought."""

    cache: Cache
    """The cache that the file belongs to, after the import."""

    records_new: int
    """Records of the file that the cache did not hold before."""


class Cache:
    """The records of a scene's light field, on the server; grows, and never changes what it holds."""

    def __init__(self, connection: Connection, name: str, message: cache_pb2.Cache | None = None) -> None:
        """Made by `Service.cache`, `Service.caches` and `Scene.cache`, not by users."""
        self._connection = connection
        self._message = message
        self.name = name
        """The name on the server, "caches/{fingerprint}"."""

    def __repr__(self) -> str:
        """The name."""
        return f"<fogbank.Cache {self.name}>"

    @property
    def statistics(self) -> CacheStatistics:
        """What it held when this client last heard of it; asks the server the first time."""
        if self._message is None:
            return self.show()
        return CacheStatistics.from_message(self._message)

    def show(self) -> CacheStatistics:
        """Asks the server what it holds now. Raises NotFoundError for a scene without records."""
        response = self._connection.call(lambda stubs: stubs.caches.GetCache, cache_pb2.GetCacheRequest(name=self.name))
        self._message = response.cache
        return CacheStatistics.from_message(response.cache)

    def export(self, path: str | os.PathLike[str]) -> None:
        """Downloads the whole cache as one file; the same records give the same bytes on any machine."""

        def chunks(offset: int) -> Iterator[FileChunk]:
            request = cache_pb2.ExportCacheRequest(name=self.name, offset=offset)
            for response in self._connection.stubs.caches.ExportCache(request):
                yield _file_chunk(response.chunk)

        save_stream(self._connection, chunks, Path(path), self.name)

    def import_(self, path: str | os.PathLike[str], *, on_progress: ProgressSink | None = None) -> ImportReport:
        """Adds the records of an exported file of the same scene; FailedPreconditionError for another scene's."""
        return import_cache(self._connection, Path(path), cache=self.name, on_progress=on_progress)

    def verify(self) -> VerifyReport:
        """Checks every byte on the server's disk; what is damaged is set aside and made again when it is needed."""
        response = self._connection.call(
            lambda stubs: stubs.caches.VerifyCache, cache_pb2.VerifyCacheRequest(name=self.name)
        )
        return VerifyReport(
            records=response.records,
            segments=response.segments,
            damaged_segments=response.damaged_segments,
            bytes=response.bytes,
        )

    def delete(self) -> None:
        """Removes it; running jobs go on with the records that they have."""
        self._connection.call(
            lambda stubs: stubs.caches.DeleteCache,
            cache_pb2.DeleteCacheRequest(name=self.name),
            # A retry could not tell its own success from a cache that never was.
            idempotent=False,
        )
        self._message = None


class SceneCache(Cache):
    """The cache of a loaded scene."""

    def __init__(self, connection: Connection, name: str, scene: str) -> None:
        """Made by `Scene.cache`, not by users."""
        super().__init__(connection, name)
        self._scene = scene

    def fill(
        self,
        cameras: Sequence[CameraLike] = (),
        *,
        on_progress: Callable[[FillProgress], None] | None = None,
        **options: Unpack[RenderOptions],
    ) -> FillProgress:
        """Makes the records that pictures from these cameras need, and no picture; returns the last report.

        Args:
            cameras: in the order in which records are made for them; empty for the scene's own alone.
            on_progress: told how far it is, a few times a second.
            options: as of the renders that are going to use the records; see `fogbank.RenderOptions`.

        An exception of `on_progress` ends the fill; the records made until then stay. Broken connections are taken up
        again: what the cache holds is not made twice.
        """
        for report in self.fill_events(cameras, **options):
            if on_progress is not None:
                on_progress(report)
        return report

    def fill_events(
        self, cameras: Sequence[CameraLike] = (), **options: Unpack[RenderOptions]
    ) -> Iterator[FillProgress]:
        """As `fill`, yielding how far it is; dropping the generator ends the fill."""
        request = cache_pb2.FillCacheRequest(
            scene=self._scene,
            settings=settings_message(options),
            cameras=[camera_message(camera) for camera in cameras],
        )
        backoff = Backoff(self._connection.retry_policy)
        while True:
            call = self._connection.stubs.caches.FillCache(request, metadata=trace_metadata())
            try:
                for response in call:
                    backoff.progressed()
                    yield FillProgress.from_message(response)
                    if response.done:
                        return
                error: FogbankError = UnavailableError(f"the fill of {self.name} broke off")
            except grpc.RpcError as rpc_error:
                error = self._connection.translate(rpc_error)
            finally:
                # Also reached when the generator is dropped; after the regular end it does nothing.
                call.cancel()
            self._connection.wait_or_raise(backoff, error)

    def view(
        self,
        *,
        side: int | None = None,
        cut: float | None = None,
        up_axis: int | None = None,
        **options: Unpack[RenderOptions],
    ) -> CacheView:
        """What a picture of the records from above is drawn from.

        Args:
            side: longer side of the plan in pixels; 1024 by default.
            cut: world coordinate along the up axis at which the scene is cut open; the records' median by default.
            up_axis: 0, 1 or 2 for x, y, z; the one nearest to the camera's up by default.
            options: as of a render that would use the records: extents depend on `error`, and on `camera` if given.
        """
        request = cache_pb2.ViewCacheRequest(
            scene=self._scene, settings=settings_message(options), side=side or 0, cut=cut, up_axis=up_axis
        )
        return view_cache(self._connection, request)


def list_caches(connection: Connection) -> Iterator[Cache]:
    """All caches of the server, by name."""
    token = ""
    while True:
        response = connection.call(lambda stubs: stubs.caches.ListCaches, cache_pb2.ListCachesRequest(page_token=token))
        for message in response.caches:
            yield Cache(connection, message.name, message)
        token = response.next_page_token
        if not token:
            return


def import_cache(
    connection: Connection, path: Path, *, cache: str = "", on_progress: ProgressSink | None = None
) -> ImportReport:
    """Adds the records of an exported file to the cache that it belongs to, which must be `cache` if given."""
    sha256 = upload_file(connection, path, on_progress=on_progress)
    response = connection.call(
        lambda stubs: stubs.caches.ImportCache, cache_pb2.ImportCacheRequest(sha256=sha256, cache=cache)
    )
    return ImportReport(cache=Cache(connection, response.cache.name, response.cache), records_new=response.records_new)


def merge_caches(connection: Connection, paths: Sequence[Path], output: Path) -> None:
    """Writes the union of exported files of one scene as one file; their order does not matter."""
    sha256s = [upload_file(connection, path) for path in paths]

    def chunks(offset: int) -> Iterator[FileChunk]:
        request = cache_pb2.MergeCachesRequest(sha256s=sha256s, offset=offset)
        for response in connection.stubs.caches.MergeCaches(request):
            yield _file_chunk(response.chunk)

    save_stream(connection, chunks, output, "the merged cache")


def collect_garbage(connection: Connection, budget_bytes: int | None) -> GarbageReport:
    """Frees disk space of the server, down to the budget."""
    response = connection.call(
        lambda stubs: stubs.caches.CollectCacheGarbage,
        cache_pb2.CollectCacheGarbageRequest(budget_bytes=budget_bytes),
    )
    return GarbageReport(
        removed=list(response.removed), bytes_before=response.bytes_before, bytes_after=response.bytes_after
    )


def save_stream(connection: Connection, chunks: Callable[[int], Iterator[FileChunk]], path: Path, what: str) -> None:
    """Downloads to `path`; a file of that name is replaced at once or not at all. DataLossError for a wrong hash."""

    def write(file: BinaryIO) -> None:
        sha256 = download(connection, chunks, file, what)
        file.seek(0)
        found = hashlib.sha256()
        while data := file.read(_READ_BYTES):
            found.update(data)
        if found.hexdigest() != sha256:
            raise DataLossError(f"what was downloaded of {what} does not have the SHA-256 {sha256}")

    write_atomically(path, write)


def _file_chunk(message: cache_pb2.FileChunk) -> FileChunk:
    return FileChunk(message.size, message.sha256, message.offset, message.data)
