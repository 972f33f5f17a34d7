"""The engine of a worker: one fogbankd, with the scenes and replicas that it holds."""

from __future__ import annotations

import contextlib
import copy
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import grpc

from fogbank._generated.v1 import farm_pb2, render_pb2, scene_pb2
from fogbank.channel import Connection
from fogbank.embedded import EmbeddedServer
from fogbank.errors import CallCancelledError, FogbankError, InternalError, UnavailableError
from fogbank.farm.parcels import Batch, BatchResult, FilePiece, JobIdentity, LogSegment, Refusal, WorkerReport
from fogbank.service import Service

# A replica that is gone, or a server that died, is made anew so often for one batch.
_ATTEMPTS = 3


class _LacksError(Exception):
    """The worker has not got what the batch needs."""

    def __init__(self, what: Literal["scene", "log"], log_length: int) -> None:
        super().__init__(what)
        self.what = what
        self.log_length = log_length


class Engine:
    """Performs batches on a server of its own, which is started at the first one and again when it died.

    Thread-safe; batches may be performed side by side and share the server's threads.
    """

    def __init__(self, worker: str, pool: Path, *, threads: int, memory_bytes: int | None) -> None:
        """Starts nothing yet.

        Args:
            worker: name that results carry.
            pool: folder of data directories, of which the server takes a free one: its scene files outlast the worker.
            threads: render threads of the server.
            memory_bytes: most memory of the server; None for no limit.
        """
        self._worker = worker
        self._pool = pool
        self._threads = threads
        self._memory_bytes = memory_bytes
        self._lock = threading.Lock()
        # Apart, so that nothing that takes long can hold up a cancellation.
        self._calls_lock = threading.Lock()
        self._service: Service | None = None
        self._replicas: dict[JobIdentity, tuple[str, int]] = {}
        self._calls: dict[str, grpc.Call] = {}
        self._cancelled: set[str] = set()
        self._report = WorkerReport(threads=threads)

    def perform(self, batch: Batch, log: Sequence[LogSegment], files: Sequence[FilePiece]) -> BatchResult:
        """Performs a batch.

        Args:
            batch: the tasks.
            log: entries that the replica may lack, ascending; others need not be among them.
            files: what the server may lack of the scene's files, each file's pieces in order.
        """
        started = time.monotonic()
        self._report.running.append(batch.number)
        parts: list[bytes] = []
        length = 0
        try:
            for attempt in range(_ATTEMPTS):
                parts.clear()
                try:
                    with self._lock:
                        service = self._running_service()
                        replica = self._open(service, batch.identity, files)
                        length = self._advance(service, batch, replica, log)
                    parts.extend(self._perform(service, replica, batch))
                    break
                except CallCancelledError:
                    return BatchResult(self._worker, log_length=length)
                except _LacksError as error:
                    return BatchResult(self._worker, log_length=error.log_length, lacks=error.what)
                except FogbankError as error:
                    gone = error.reason == "REPLICA_NOT_FOUND" or isinstance(error, UnavailableError)
                    if not gone or attempt + 1 == _ATTEMPTS:
                        return BatchResult(self._worker, refusal=Refusal(error.reason, error.message))
                    self._forget(batch.identity)
            self._report.batches += 1
            return BatchResult(self._worker, parts=tuple(parts), log_length=length, seconds=time.monotonic() - started)
        finally:
            self._report.running.remove(batch.number)

    def cancel(self, numbers: Sequence[str]) -> None:
        """Stops batches; those that are not being performed yet are stopped when they begin."""
        with self._calls_lock:
            self._cancelled.update(numbers)
            calls = [self._calls[number] for number in numbers if number in self._calls]
        for call in calls:
            call.cancel()

    def close_replica(self, log: str) -> None:
        """Closes the replicas of a job's log."""
        with self._lock:
            gone = [identity for identity in self._replicas if identity.log == log]
            names = [self._replicas.pop(identity)[0] for identity in gone]
            service = self._service
        if service is None:
            return
        for name in names:
            with contextlib.suppress(FogbankError):
                service.connection.call(
                    lambda stubs: stubs.farm.CloseReplica, farm_pb2.CloseReplicaRequest(replica=name)
                )

    def report(self) -> WorkerReport:
        """How it is doing."""
        return copy.deepcopy(self._report)

    def close(self) -> None:
        """Ends the server; harmless when repeated."""
        with self._lock:
            service, self._service = self._service, None
        if service is not None:
            service.close()

    def _running_service(self) -> Service:
        if self._service is not None:
            return self._service
        self._replicas.clear()
        server = EmbeddedServer(data_pool=self._pool, threads=self._threads, memory_bytes=self._memory_bytes)
        try:
            self._service = Service(Connection(server.target, explain_unavailable=server.failure), server)
        except BaseException:
            server.stop()
            raise
        self._report.build_id = self._service.capabilities.build_id
        self._report.server_starts += 1
        return self._service

    def _forget(self, identity: JobIdentity) -> None:
        """Drops what turned out to be gone: the replica, and the server if it died."""
        with self._lock:
            self._replicas.pop(identity, None)
            service = self._service
            if service is None or service.alive:
                return
            self._service = None
        service.close()

    def _open(self, service: Service, identity: JobIdentity, files: Sequence[FilePiece]) -> str:
        known = self._replicas.get(identity)
        if known is not None:
            return known[0]
        request = farm_pb2.OpenReplicaRequest(
            scene=identity.scene,
            settings=render_pb2.RenderSettings.FromString(identity.settings),
            log=identity.log,
            build_id=identity.build_id,
        )
        try:
            response = service.connection.call(lambda stubs: stubs.farm.OpenReplica, request)
        except FogbankError as error:
            if error.reason != "SCENE_NOT_FOUND":
                raise
            self._create_scene(service, identity, files)
            response = service.connection.call(lambda stubs: stubs.farm.OpenReplica, request)
        self._replicas[identity] = (response.replica, response.log_length)
        return response.replica

    def _create_scene(self, service: Service, identity: JobIdentity, files: Sequence[FilePiece]) -> None:
        manifest = scene_pb2.SceneManifest.FromString(identity.manifest)
        missing = service.connection.call(
            lambda stubs: stubs.scenes.PrepareScene, scene_pb2.PrepareSceneRequest(manifest=manifest)
        ).missing_blobs
        if not set(missing) <= {piece.sha256 for piece in files}:
            raise _LacksError("scene", 0)
        for sha256 in missing:
            pieces = [piece for piece in files if piece.sha256 == sha256]
            try:
                service.connection.stubs.scenes.UploadBlob(
                    _upload_messages(pieces, service.connection.upload_chunk_bytes)
                )
            except grpc.RpcError as error:
                raise service.connection.translate(error) from None
            self._report.scene_bytes += pieces[0].size
        created = service.connection.call(
            lambda stubs: stubs.scenes.CreateScene,
            scene_pb2.CreateSceneRequest(request_id=uuid.uuid4().hex, manifest=manifest),
        )
        if created.scene.name != identity.scene:
            raise InternalError(f"the files of {identity.scene} make {created.scene.name} here")

    def _advance(self, service: Service, batch: Batch, replica: str, log: Sequence[LogSegment]) -> int:
        _, length = self._replicas[batch.identity]
        for segment in log:
            if segment.end <= length:
                continue
            if segment.first > length:
                break
            request = farm_pb2.AdvanceReplicaRequest(
                replica=replica,
                entries=[farm_pb2.JobLogEntry.FromString(entry) for entry in segment.entries[length - segment.first :]],
            )
            try:
                response = service.connection.call(lambda stubs: stubs.farm.AdvanceReplica, request)
            except FogbankError as error:
                if error.reason == "REPLICA_BEHIND":
                    # Opened again behind our back: it replays from where it stands.
                    raise _LacksError("log", int(error.metadata.get("log_length", "0"))) from None
                raise
            length = response.log_length
            self._report.log_bytes += request.ByteSize()
            self._replicas[batch.identity] = (replica, length)
        if length < batch.log_length:
            raise _LacksError("log", length)
        return length

    def _perform(self, service: Service, replica: str, batch: Batch) -> Iterator[bytes]:
        request = farm_pb2.PerformTasksRequest(
            replica=replica,
            log_length=batch.log_length,
            tasks=[farm_pb2.LeasedTask.FromString(task) for task in batch.tasks],
        )
        call = service.connection.stubs.farm.PerformTasks(request)
        with self._calls_lock:
            self._calls[batch.number] = call
            if batch.number in self._cancelled:
                call.cancel()
        try:
            for response in call:
                part = response.part
                self._report.result_bytes += len(part.data)
                if part.last:
                    self._report.tasks += 1
                    self._report.task_seconds += part.cpu_seconds
                yield part.SerializeToString()
        except grpc.RpcError as error:
            raise service.connection.translate(error) from None
        finally:
            with self._calls_lock:
                del self._calls[batch.number]
                self._cancelled.discard(batch.number)


def _upload_messages(pieces: Sequence[FilePiece], chunk_bytes: int) -> Iterator[scene_pb2.UploadBlobRequest]:
    yield scene_pb2.UploadBlobRequest(
        header=scene_pb2.UploadBlobHeader(sha256=pieces[0].sha256, size=pieces[0].size, offset=0)
    )
    for piece in pieces:
        for start in range(0, len(piece.data), chunk_bytes):
            yield scene_pb2.UploadBlobRequest(chunk=piece.data[start : start + chunk_bytes])
