"""Downloading a file that a server streams, taking up broken streams where they broke."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import BinaryIO, NamedTuple

import grpc

from fogbank.channel import Connection
from fogbank.errors import DataLossError, FogbankError, UnavailableError
from fogbank.retry import Backoff


class FileChunk(NamedTuple):
    """A piece of a file."""

    size: int
    """Of the whole file in bytes."""

    sha256: str
    """Of the whole file, 64 lower-case hexadecimal digits."""

    offset: int
    """Where the piece begins."""

    data: bytes
    """The piece."""


def download(connection: Connection, chunks: Callable[[int], Iterator[FileChunk]], file: BinaryIO, what: str) -> str:
    """Writes the whole file to `file`, from its beginning, and returns the SHA-256 that the server names.

    Args:
        connection: whose retry policy counts.
        chunks: opens a stream that begins at the given byte; raises grpc.RpcError where it breaks.
        file: empty; seekable. Begun anew when the server's file has changed between two streams.
        what: for messages, such as "the image of jobs/...".

    Raises DataLossError for pieces that do not fit together. Whether the bytes have the SHA-256 is for the caller to
    check.
    """
    backoff = Backoff(connection.retry_policy)
    offset = 0
    sha256 = ""
    while True:
        size = None
        try:
            for chunk in chunks(offset):
                if sha256 not in ("", chunk.sha256):
                    break
                if chunk.offset != offset:
                    raise DataLossError(f"byte {offset} of {what} expected, got {chunk.offset}")
                file.write(chunk.data)
                offset += len(chunk.data)
                size, sha256 = chunk.size, chunk.sha256
                backoff.progressed()
            if size is not None and offset >= size:
                return sha256
            error: FogbankError = UnavailableError(f"{what} broke off at byte {offset}")
            if size is None:
                offset, sha256 = 0, ""
                file.seek(0)
                file.truncate()
        except grpc.RpcError as rpc_error:
            error = connection.translate(rpc_error)
        connection.wait_or_raise(backoff, error)
