"""A job's log on its way to the workers."""

from __future__ import annotations

import hashlib

from distributed import Client, Future

from fogbank._generated.v1 import farm_pb2
from fogbank.channel import Connection
from fogbank.farm.parcels import LogSegment
from fogbank.farm.plugin import hold


class JobLog:
    """Reads the log's entries and hands them to Dask in segments, named by their contents: those that two jobs have in
    common, such as the records of frames of one sweep, travel once."""

    def __init__(self, connection: Connection, job: str, log: str) -> None:
        """Of one life of a job."""
        self.id = log
        self._connection = connection
        self._job = job
        self._segments: list[LogSegment] = []
        self._futures: list[Future[object]] = []
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

    def futures(self, client: Client, first: int) -> list[Future[object]]:
        """The segments that hold entries from `first` on; they stay with Dask as long as this object lives."""
        for segment in self._segments[len(self._futures) :]:
            digest = hashlib.sha256(repr(segment.first).encode())
            for entry in segment.entries:
                digest.update(entry)
            self._futures.append(client.submit(hold, segment, key=f"fogbank_log-{digest.hexdigest()}"))
        return [future for segment, future in zip(self._segments, self._futures, strict=True) if segment.end > first]

    def submit_again(self) -> None:
        """What Dask held is lost."""
        self._futures = []
