"""The caches of the fake server: sets of numbers that stand for records."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

import grpc
from fogbank._generated.v1 import cache_pb2, render_pb2

CHUNK = 16
CAMERA_RECORDS = 10
CACHE = "caches/" + "c" * 64
PLAN_SIZE = (6, 4)


class FakeCaches:
    """One cache; a fill makes ten records for each camera that it has not seen.

    Attributes:
        records: of the cache, sorted lines of a file.
        seen: cameras that were filled for.
        fill_requests: as they came.
        cut_fills_after: responses after which a fill breaks off, one entry per call.
    """

    def __init__(self) -> None:
        """An empty cache."""
        self.records: set[str] = set()
        self.seen: list[cache_pb2.FillCacheRequest] = []
        self.fill_requests: list[cache_pb2.FillCacheRequest] = []
        self.view_requests: list[cache_pb2.ViewCacheRequest] = []
        self.cut_fills_after: list[int] = []
        self.cut_exports_after: list[int] = []
        self.epoch = 0

    def message(self, *, components: bool = True) -> cache_pb2.Cache:
        """The cache."""
        message = cache_pb2.Cache(
            name=CACHE, records=len(self.records), epoch=self.epoch, disk_bytes=1000, memory_bytes=2000, segments=1
        )
        if components:
            message.components.add(quantity=cache_pb2.RECORD_QUANTITY_REST, records=len(self.records))
        message.last_use_time.FromSeconds(1_700_000_000)
        return message

    def fill(
        self, request: cache_pb2.FillCacheRequest, context: grpc.ServicerContext
    ) -> Iterator[cache_pb2.FillCacheResponse]:
        """Reports after each camera."""
        self.fill_requests.append(request)
        left = self.cut_fills_after.pop(0) if self.cut_fills_after else None
        reused = len(self.records)
        cameras: list[render_pb2.CameraOverride | None] = [*request.cameras] or [None]
        yield cache_pb2.FillCacheResponse(cameras_total=len(cameras), records_reused=reused, cache=CACHE)
        for number, camera in enumerate(cameras):
            if left == number:
                context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
            before = len(self.records)
            self.records |= {f"{camera}{index}".replace("\n", " ") for index in range(CAMERA_RECORDS)}
            self.epoch += len(self.records) > before
            yield cache_pb2.FillCacheResponse(
                cameras_done=number + 1,
                cameras_total=len(cameras),
                fraction=(number + 1) / len(cameras),
                records_reused=reused,
                records_new=len(self.records) - reused,
                epoch=self.epoch,
                rays=100 * (number + 1),
                elapsed_seconds=0.5,
                done=number + 1 == len(cameras),
                cache=CACHE,
            )

    def export(self) -> bytes:
        """The cache as a file."""
        return file_of(self.records)

    def view(self) -> Iterator[cache_pb2.ViewCacheResponse]:
        """A floor with a block on it, and two records."""
        width, height = PLAN_SIZE
        yield cache_pb2.ViewCacheResponse(
            plan=cache_pb2.PlanView(
                width=width, height=height, right_axis=0, down_axis=2, up_axis=1, left=-3, top=-2, pixel_size=1, cut=0.5
            )
        )
        for row in range(height):
            yield cache_pb2.ViewCacheResponse(
                rows=cache_pb2.PlanRows(
                    depth=[float("inf") if column == 0 else 1.0 for column in range(width)],
                    facing=[1.0] * width,
                    solid=bytes(row == 1 and column == 2 for column in range(width)),
                )
            )
        component = cache_pb2.CacheComponent(quantity=cache_pb2.RECORD_QUANTITY_REST, records=2)
        for x, radius in ((1.0, 0.5), (-1.0, 0.125)):
            yield cache_pb2.ViewCacheResponse(
                records=cache_pb2.RecordExtents(
                    component=component,
                    places=2,
                    positions=[x, 0.5, 0.0],
                    semi_axes=[radius, 0, 0, 0, radius, 0, 0, 0, radius],
                )
            )


def file_of(records: set[str]) -> bytes:
    """A set as a file: the same set gives the same bytes."""
    return ("FAKE CACHE\n" + "\n".join(sorted(records))).encode()


def records_of(data: bytes) -> set[str] | None:
    """The set of a file; None for something else."""
    head, _, lines = data.decode("latin-1").partition("\n")
    return set(lines.split("\n")) - {""} if head == "FAKE CACHE" else None


def chunks(data: bytes, offset: int) -> Iterator[cache_pb2.FileChunk]:
    """A file in pieces, from a byte on."""
    digest = hashlib.sha256(data).hexdigest()
    for start in range(offset, max(len(data), offset + 1), CHUNK):
        yield cache_pb2.FileChunk(size=len(data), sha256=digest, offset=start, data=data[start : start + CHUNK])
