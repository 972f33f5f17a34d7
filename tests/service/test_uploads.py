"""Blobs: content-addressed, checked, resumable."""

from __future__ import annotations

from collections.abc import Iterator

import grpc
import pytest
from fogbank._generated.v1 import scene_pb2 as scene

from tests.service.harness import Server, error_info, new_request_id, sha256


def header(
    data: bytes, *, digest: str | None = None, size: int | None = None, offset: int = 0
) -> scene.UploadBlobRequest:
    """First message of an upload."""
    return scene.UploadBlobRequest(
        header=scene.UploadBlobHeader(
            sha256=digest or sha256(data), size=len(data) if size is None else size, offset=offset
        )
    )


def chunk(data: bytes) -> scene.UploadBlobRequest:
    """Any other message of an upload."""
    return scene.UploadBlobRequest(chunk=data)


def fresh() -> bytes:
    """Bytes that no other test has uploaded."""
    return new_request_id().encode() * 3000


def test_upload_and_query(server: Server) -> None:
    data = fresh()
    query = scene.QueryBlobRequest(sha256=sha256(data))
    assert server.scenes.QueryBlob(query).committed_size == 0
    server.upload(data)
    answer = server.scenes.QueryBlob(query)
    assert (answer.committed_size, answer.complete) == (len(data), True)
    server.upload(data)


def test_an_empty_blob_is_a_blob(server: Server) -> None:
    server.upload(b"")
    assert server.scenes.QueryBlob(scene.QueryBlobRequest(sha256=sha256(b""))).complete


def test_a_broken_upload_goes_on_where_it_was(server: Server) -> None:
    data = fresh()
    half = len(data) // 2
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.UploadBlob(iter([header(data), chunk(data[:half])]))
    assert error_info(caught.value).reason == "BLOB_SIZE_MISMATCH"
    committed = server.scenes.QueryBlob(scene.QueryBlobRequest(sha256=sha256(data))).committed_size
    assert committed == half
    answer = server.scenes.UploadBlob(iter([header(data, offset=half), chunk(data[half:])]))
    assert answer.committed_size == len(data)


def test_fifty_disconnects(server: Server) -> None:
    data = fresh() * 2
    step = len(data) // 50
    query = scene.QueryBlobRequest(sha256=sha256(data))
    while not (answer := server.scenes.QueryBlob(query)).complete:
        offset = answer.committed_size
        piece = data[offset : offset + step]
        last = offset + step >= len(data)

        def messages(offset: int = offset, piece: bytes = piece) -> Iterator[scene.UploadBlobRequest]:
            yield header(data, offset=offset)
            yield chunk(piece)

        if last:
            server.scenes.UploadBlob(messages())
        else:
            with pytest.raises(grpc.RpcError):
                server.scenes.UploadBlob(messages())
    assert answer.committed_size == len(data)


DATA = b"some bytes that never arrive in full"

BAD_UPLOADS: dict[str, tuple[list[scene.UploadBlobRequest], grpc.StatusCode, str]] = {
    "no message": ([], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_UPLOAD"),
    "chunk first": ([chunk(b"x")], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_UPLOAD"),
    "second header": ([header(DATA), header(DATA)], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_UPLOAD"),
    "empty chunk": ([header(DATA), chunk(b"")], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_UPLOAD"),
    "malformed hash": ([header(DATA, digest="xyz")], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_SHA256"),
    "upper-case hash": (
        [header(DATA, digest=sha256(DATA).upper())],
        grpc.StatusCode.INVALID_ARGUMENT,
        "INVALID_SHA256",
    ),
    "hash that is a path": (
        [header(DATA, digest="../" * 21 + "x")],
        grpc.StatusCode.INVALID_ARGUMENT,
        "INVALID_SHA256",
    ),
    "wrong hash": (
        [header(DATA, digest="0" * 64), chunk(DATA)],
        grpc.StatusCode.INVALID_ARGUMENT,
        "BLOB_HASH_MISMATCH",
    ),
    "too many bytes": (
        [header(DATA, size=5), chunk(DATA)],
        grpc.StatusCode.INVALID_ARGUMENT,
        "BLOB_SIZE_MISMATCH",
    ),
    "negative size": ([header(DATA, size=-1)], grpc.StatusCode.INVALID_ARGUMENT, "INVALID_UPLOAD"),
    "huge size": ([header(DATA, size=1 << 50)], grpc.StatusCode.RESOURCE_EXHAUSTED, "BLOB_TOO_LARGE"),
    "skipped offset": (
        [header(b"never seen", offset=4)],
        grpc.StatusCode.OUT_OF_RANGE,
        "UPLOAD_OFFSET_MISMATCH",
    ),
    "chunk above the limit": (
        [header(b"z" * (1 << 20)), chunk(b"z" * ((256 << 10) + 1))],
        grpc.StatusCode.INVALID_ARGUMENT,
        "CHUNK_TOO_LARGE",
    ),
}


@pytest.mark.parametrize("case", BAD_UPLOADS)
def test_bad_uploads(server: Server, case: str) -> None:
    messages, code, reason = BAD_UPLOADS[case]
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.UploadBlob(iter(messages))
    assert caught.value.code() == code
    info = error_info(caught.value)
    assert info.reason == reason
    if case == "skipped offset":
        assert info.metadata["committed_size"] == "0"


def test_a_message_above_the_limit(server: Server) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        server.scenes.UploadBlob(iter([header(DATA), chunk(b"z" * (5 << 20))]))
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert not server.scenes.QueryBlob(scene.QueryBlobRequest(sha256=sha256(b"unknown"))).complete


def test_partial_uploads_survive_a_restart(own_server: Server) -> None:
    data = fresh()
    half = len(data) // 2
    with pytest.raises(grpc.RpcError):
        own_server.scenes.UploadBlob(iter([header(data), chunk(data[:half])]))
    assert own_server.stop() == 0
    again = Server(own_server.data)
    assert again.scenes.QueryBlob(scene.QueryBlobRequest(sha256=sha256(data))).committed_size == half
    again.scenes.UploadBlob(iter([header(data, offset=half), chunk(data[half:])]))
    assert again.stop() == 0
