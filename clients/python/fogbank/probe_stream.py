"""The stream that carries points to a server and results back."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from queue import SimpleQueue

import grpc
import numpy as np

from fogbank._generated.v1 import probe_pb2
from fogbank.channel import Connection
from fogbank.errors import CallCancelledError, FogbankError, UnavailableError
from fogbank.probe import FloatArray, PointsLike, ProbeResult, point_array, result_from_message
from fogbank.retry import Backoff
from fogbank.tracing import trace_metadata

# As max_probe_chunk_points; an end-to-end test compares the two.
CHUNK_POINTS = 256

# Chunks that are sent ahead of their results: the server works on four of them, the others are on their way.
_CHUNKS_AHEAD = 8


def probe_stream(
    connection: Connection, scene: str, settings: probe_pb2.ProbeSettings, points: Iterable[PointsLike]
) -> Iterator[ProbeResult]:
    """Results in the order of the points, up to CHUNK_POINTS at a time.

    Holds no more than a few chunks, however many points there are. A broken connection is taken up again with the
    points that were not answered. Dropping the generator ends the work.
    """
    stream = _Stream(connection, probe_pb2.ProbeHeader(scene=scene, settings=settings))
    try:
        for chunk in _chunks(points):
            stream.send(chunk)
            if stream.ahead >= _CHUNKS_AHEAD:
                yield stream.receive()
        stream.half_close()
        while stream.ahead > 0:
            yield stream.receive()
        stream.finish()
    finally:
        stream.close()


def _chunks(points: Iterable[PointsLike]) -> Iterator[FloatArray]:
    """Cuts and joins arrays of any length to chunks of CHUNK_POINTS; the last one may be shorter."""
    waiting: list[FloatArray] = []
    count = 0
    for item in points:
        array = point_array(item)
        while count + len(array) >= CHUNK_POINTS:
            cut = CHUNK_POINTS - count
            yield np.concatenate([*waiting, array[:cut]])
            array, waiting, count = array[cut:], [], 0
        if len(array):
            # A copy: the caller may use its array again for the next points.
            waiting.append(array.copy())
            count += len(array)
    if waiting:
        yield np.concatenate(waiting)


class _Stream:
    """A Probe stream that is opened again when the connection breaks."""

    def __init__(self, connection: Connection, header: probe_pb2.ProbeHeader) -> None:
        """Opens it."""
        self._connection = connection
        self._header = header
        self._backoff = Backoff(connection.retry_policy)
        self._unanswered: deque[FloatArray] = deque()
        self._answered_points = 0
        self._trace = trace_metadata()
        self._half_closed = False
        self._media: tuple[str, ...] = ()
        self._open()

    def _open(self) -> None:
        # Points that were answered on an earlier connection; this one counts from 0.
        self._base = self._answered_points
        self._requests: SimpleQueue[probe_pb2.ProbeRequest | None] = SimpleQueue()
        self._requests.put(probe_pb2.ProbeRequest(header=self._header))
        for chunk in self._unanswered:
            self._put(chunk)
        if self._half_closed:
            self._requests.put(None)
        self._call = self._connection.stubs.probe.Probe(iter(self._requests.get, None), metadata=self._trace)

    def _put(self, chunk: FloatArray) -> None:
        self._requests.put(probe_pb2.ProbeRequest(points=probe_pb2.ProbePoints(coordinates=chunk.ravel())))

    @property
    def ahead(self) -> int:
        """Chunks that were sent and not answered."""
        return len(self._unanswered)

    def send(self, chunk: FloatArray) -> None:
        """Sends a chunk; does not wait."""
        self._unanswered.append(chunk)
        self._put(chunk)

    def half_close(self) -> None:
        """No more points will come."""
        self._half_closed = True
        self._requests.put(None)

    def receive(self) -> ProbeResult:
        """The results of the oldest unanswered chunk."""
        while True:
            response = self._next()
            if response is None:
                self._retry(UnavailableError("the stream of results broke off before the last of them"))
            elif response.HasField("started"):
                self._media = tuple(response.started.media)
            else:
                self._backoff.progressed()
                chunk = self._unanswered.popleft()
                self._answered_points += len(chunk)
                return result_from_message(response.results, chunk, self._header.settings, self._media)

    def finish(self) -> None:
        """Waits for the end of the stream, which may be an error even without points."""
        while (response := self._next()) is not None:
            self._media = tuple(response.started.media)

    def close(self) -> None:
        """Ends the stream, and the thread that gRPC sends requests with."""
        self._requests.put(None)
        self._call.cancel()

    def _next(self) -> probe_pb2.ProbeResponse | None:
        while True:
            try:
                return next(self._call, None)
            except grpc.RpcError as rpc_error:
                error = self._connection.translate(rpc_error)
            if isinstance(error, CallCancelledError):
                # Not by this client: servers cut streams that nobody reads.
                error = UnavailableError("the server ended the stream of results")
            self._retry(error)

    def _retry(self, error: FogbankError) -> None:
        self.close()
        self._connection.wait_or_raise(self._backoff, self._renumbered(error))
        self._open()

    def _renumbered(self, error: FogbankError) -> FogbankError:
        """After a new connection the server counts points from where that began."""
        field = error.metadata.get("field", "")
        if error.reason != "INVALID_POINT" or self._base == 0:
            return error
        number = int(field.removeprefix("points[").removesuffix("]")) + self._base
        renamed = f"points[{number}]"
        message = error.message.replace(field, renamed, 1)
        return type(error)(message, reason=error.reason, metadata={"field": renamed}, code=error.code)
