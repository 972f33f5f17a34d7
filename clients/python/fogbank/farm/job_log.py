"""A job's log on its way to the workers."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from distributed import Client, Future

from fogbank._generated.v1 import farm_pb2
from fogbank.channel import Connection
from fogbank.farm.parcels import LogSegment
from fogbank.farm.plugin import hold

# Entries together no larger than this travel with every batch: a task that holds them would take the scheduler longer.
_MOST_ENCLOSED_BYTES = 64 << 10


class JobLog:
    """Reads the log's entries and hands them to Dask in segments. Large ones are named by their contents: those that
    two jobs have in common, such as the records of frames of one sweep, travel once."""

    def __init__(self, connection: Connection, job: str, log: str) -> None:
        """Of one life of a job."""
        self.id = log
        self._connection = connection
        self._job = job
        self._segments: list[LogSegment] = []
        self._futures: dict[int, Future[object]] = {}
        self.bytes = 0

    @property
    def length(self) -> int:
        """Entries read so far."""
        return self._segments[-1].end if self._segments else 0

    def read(self, length: int) -> None:
        """Reads until there are so many entries; FogbankError when the log is gone."""
        while self.length < length:
            request = farm_pb2.ReadJobLogRequest(job=self._job, log=self.id, first=self.length)
            response = self._connection.call(lambda stubs: stubs.farm.ReadJobLog, request)
            self.bytes += sum(len(entry.data) for entry in response.entries)
            entries = tuple(entry.SerializeToString() for entry in response.entries)
            self._segments.append(LogSegment(self.length, entries))

    def segments(self, client: Client, first: int) -> Sequence[LogSegment | Future[object]]:
        """What holds the entries from `first` on, ascending, as an argument of a task: the newest ones themselves while
        they are small, others as futures, which stay with Dask as long as this object lives."""
        chosen: list[LogSegment | Future[object]] = []
        room = _MOST_ENCLOSED_BYTES
        for segment in reversed(self._segments):
            if segment.end <= first:
                break
            room -= segment.size
            chosen.append(segment if room >= 0 else self._future(client, segment))
        return chosen[::-1]

    def _future(self, client: Client, segment: LogSegment) -> Future[object]:
        if segment.first not in self._futures:
            digest = hashlib.sha256(repr(segment.first).encode())
            for entry in segment.entries:
                digest.update(entry)
            self._futures[segment.first] = client.submit(hold, segment, key=f"fogbank_log-{digest.hexdigest()}")
        return self._futures[segment.first]

    def submit_again(self) -> None:
        """What Dask held is lost."""
        self._futures = {}
