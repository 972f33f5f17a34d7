"""Pushing a scene: finding out what the server lacks, and sending it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import grpc

from fogbank._generated.v1 import scene_pb2
from fogbank.channel import Connection
from fogbank.errors import FogbankError, InternalError, InvalidSceneError, scene_error
from fogbank.hash_cache import HashCache
from fogbank.paths import cache_folder
from fogbank.retry import Backoff
from fogbank.scene_files import LocalFile, SceneFiles

# A file that an editor or exporter is still writing may change between hashing and sending; after this many rounds
# the user is told instead.
_MOST_CHANGES_OF_A_FILE = 3

# A blob is sent again only if the server drops it in between; more than this is an error of the server.
_MOST_SENDINGS_OF_A_BLOB = 3


@dataclass(frozen=True)
class UploadProgress:
    """How far a push is."""

    path: str
    """The file being sent, relative to the scene's root."""

    file_bytes_sent: int
    """Bytes of this file that the server has been sent."""

    file_bytes: int
    """Size of this file."""

    files_known: int
    """Files that the scene is known to use so far."""


ProgressSink = Callable[[UploadProgress], None]


def push(
    connection: Connection,
    files: SceneFiles,
    options: scene_pb2.LoadOptions,
    *,
    on_progress: ProgressSink | None = None,
) -> scene_pb2.SceneManifest:
    """Uploads what the server lacks, until its XML files name nothing more that exists here.

    Args:
        connection: the server.
        files: the scene's files; grows as the server finds references.
        options: how the scene is going to be read (search folders may depend on parameters).
        on_progress: told about every chunk.

    Returns: the complete manifest, for CreateScene. Raises InvalidSceneError for malformed XML and for references
    that leave the root.
    """
    looked_for: set[str] = set()
    sent: Counter[str] = Counter()
    while True:
        manifest = files.manifest(options)
        try:
            response = connection.call(
                lambda stubs: stubs.scenes.PrepareScene, scene_pb2.PrepareSceneRequest(manifest=manifest)
            )
        except FogbankError as error:
            raise scene_error(error) from None
        for sha256 in response.missing_blobs:
            file = files.by_sha256(sha256)
            if file is None or sent[sha256] >= _MOST_SENDINGS_OF_A_BLOB:
                raise InternalError(f"the server asks for the blob {sha256}, which it was not told of or has already")
            _Upload(connection, files, file, on_progress).run()
            sent[sha256] += 1
        # A reference may have several candidates, and a missing file is for CreateScene to report with its line.
        candidates = [path for path in response.unlisted_paths if path not in looked_for]
        looked_for.update(candidates)
        found = [path for path in candidates if files.add(path)]
        if not response.missing_blobs and not found:
            return manifest


def upload_file(connection: Connection, path: Path, *, on_progress: ProgressSink | None = None) -> str:
    """Uploads one file unless the server has it, and returns its SHA-256.

    Raises OSError when it cannot be read.
    """
    path.open("rb").close()
    with closing(HashCache(cache_folder() / "hashes.sqlite")) as hash_cache:
        files = SceneFiles(path, None, hash_cache)
        while True:
            (file,) = files.files
            response = connection.call(
                lambda stubs: stubs.scenes.QueryBlob, scene_pb2.QueryBlobRequest(sha256=file.sha256)
            )
            if response.complete:
                return file.sha256
            _Upload(connection, files, file, on_progress).run()


class _Upload:
    """One blob on its way."""

    def __init__(
        self,
        connection: Connection,
        files: SceneFiles,
        file: LocalFile,
        on_progress: ProgressSink | None,
    ) -> None:
        self._connection = connection
        self._files = files
        self._file = file
        self._chunk_bytes = connection.upload_chunk_bytes
        self._on_progress = on_progress
        self._read_error: OSError | None = None

    def run(self) -> None:
        """Sends the blob, taking up a broken stream where the server has it."""
        backoff = Backoff(self._connection.retry_policy)
        changes = 0
        # One message is repeated sooner than a question about it is answered.
        offset = 0 if self._file.size <= self._chunk_bytes else self._committed_size()
        furthest = offset
        while True:
            try:
                self._connection.stubs.scenes.UploadBlob(self._messages(offset))
                return
            except grpc.RpcError as rpc_error:
                error = self._connection.translate(rpc_error)
            if self._read_error is not None:
                raise InvalidSceneError(f"cannot read {self._file.path}: {self._read_error.strerror}")
            if error.reason in ("BLOB_HASH_MISMATCH", "BLOB_SIZE_MISMATCH"):
                changes += 1
                if changes >= _MOST_CHANGES_OF_A_FILE:
                    raise InvalidSceneError(f"{self._file.path} changes while it is being sent", reason=error.reason)
                if self._files.hash_again(self._file):
                    # Another blob now: the next PrepareScene asks for it.
                    return
                offset = 0
                continue
            self._connection.wait_or_raise(backoff, error)
            offset = self._committed_size()
            if offset > furthest:
                furthest = offset
                backoff.progressed()

    def _committed_size(self) -> int:
        response = self._connection.call(
            lambda stubs: stubs.scenes.QueryBlob, scene_pb2.QueryBlobRequest(sha256=self._file.sha256)
        )
        return self._file.size if response.complete else response.committed_size

    def _messages(self, offset: int) -> Iterator[scene_pb2.UploadBlobRequest]:
        header = scene_pb2.UploadBlobHeader(sha256=self._file.sha256, size=self._file.size, offset=offset)
        yield scene_pb2.UploadBlobRequest(header=header)
        try:
            source = self._file.path.open("rb")
        except OSError as error:
            # An exception in here would end the call with an error that says nothing of the file.
            self._read_error = error
            return
        with source:
            source.seek(offset)
            sent = offset
            # Never more than declared, so that a growing file shows as a wrong hash and not as a broken stream.
            while sent < self._file.size:
                chunk = source.read(min(self._chunk_bytes, self._file.size - sent))
                if not chunk:
                    return
                yield scene_pb2.UploadBlobRequest(chunk=chunk)
                sent += len(chunk)
                if self._on_progress is not None:
                    self._on_progress(
                        UploadProgress(self._file.logical_path, sent, self._file.size, len(self._files.files))
                    )
