"""The coordinating server's side of a leased job: taking tasks, handing in results, noticing the end."""

from __future__ import annotations

import queue
import threading
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import grpc

from fogbank._generated.v1 import farm_pb2, render_pb2
from fogbank.channel import Connection
from fogbank.errors import FogbankError
from fogbank.job import Job
from fogbank.retry import Backoff

TaskNumber: TypeAlias = tuple[int, int]
"""Stage and index of a task."""

Other = TypeVar("Other")

# A long poll; it ends early for tasks, for another stage and for the end of the job.
_LEASE_SECONDS = 20.0


@dataclass(frozen=True)
class JobEnded:
    """The job has ended, or what was to be told of it cannot be had any more."""

    error: Exception | None = None


class Leases(Generic[Other]):
    """Takes tasks when they are asked for, and watches the job; tells by a queue, which others may use, too."""

    def __init__(
        self,
        connection: Connection,
        job: render_pb2.Job,
        events: queue.Queue[farm_pb2.LeaseTasksResponse | JobEnded | Other],
    ) -> None:
        """Begins to watch the job."""
        self.records = 0
        """Records that the job works with so far: those that were there, and those that it has made."""
        self._connection = connection
        self._job = job
        self._events = events
        self._wanted = 0
        self._trip_seconds = 0.0
        self._asked = threading.Semaphore(0)
        self._closed = False
        for target in (self._lease, self._watch):
            threading.Thread(target=self._guard, args=(target,), name="fogbank-farm-leases", daemon=True).start()

    def ask(self, most_tasks: int, trip_seconds: float) -> None:
        """Asks for tasks: there will be one answer, when there are some or the job is in another stage.

        Args:
            most_tasks: of the answer.
            trip_seconds: stages that take the server less are its own (LeaseTasksRequest.trip_seconds).
        """
        self._wanted = most_tasks
        self._trip_seconds = trip_seconds
        self._asked.release()

    def close(self) -> None:
        """Tells nothing any more."""
        self._closed = True
        self._asked.release()

    def _guard(self, target: Callable[[], None]) -> None:
        try:
            target()
        except Exception as error:
            self._events.put(JobEnded(error))

    def _lease(self) -> None:
        backoff = Backoff(self._connection.retry_policy)
        coordinator = uuid.uuid4().hex
        stage = 0
        while True:
            self._asked.acquire()
            if self._closed:
                return
            request = farm_pb2.LeaseTasksRequest(
                job=self._job.name,
                coordinator=coordinator,
                max_tasks=self._wanted,
                wait_seconds=_LEASE_SECONDS,
                known_stage=stage,
                trip_seconds=self._trip_seconds,
            )
            try:
                response = self._connection.call(lambda stubs: stubs.farm.LeaseTasks, request, idempotent=False)
            except FogbankError as error:
                if self._closed:
                    return
                self._connection.wait_or_raise(backoff, error)
                # A lost answer took its tasks with it: under another name all that are not complete are handed out.
                coordinator = uuid.uuid4().hex
                self._asked.release()
                continue
            backoff.progressed()
            stage = response.stage
            self._events.put(response)

    def _watch(self) -> None:
        job = Job(self._connection, self._job)
        for _ in job.events(tiles=False):
            if self._closed:
                return
            self.records = job.progress.records_reused + job.progress.records_new
        self._events.put(JobEnded())


def hand_in(
    connection: Connection, job: str, log: str, parts: Sequence[farm_pb2.TaskResultPart]
) -> tuple[int, dict[TaskNumber, str]]:
    """Hands in results.

    Args:
        connection: to the coordinating server.
        job: "jobs/{id}".
        log: id of the log that the tasks came with.
        parts: of whole results.

    Returns: how many were ignored since they came late or twice, and those that were refused with the reason.
    """
    backoff = Backoff(connection.retry_policy)
    while True:
        try:
            response = connection.stubs.farm.CompleteTasks(_messages(job, log, parts))
        except grpc.RpcError as rpc_error:
            error = connection.translate(rpc_error)
            if error.reason in ("LOG_CHANGED", "JOB_NOT_RUNNING"):
                return len(parts), {}
            connection.wait_or_raise(backoff, error)
            continue
        return response.ignored, {
            (item.stage, item.index): f"{item.reason}: {item.message}" for item in response.refused
        }


def _messages(job: str, log: str, parts: Sequence[farm_pb2.TaskResultPart]) -> Iterator[farm_pb2.CompleteTasksRequest]:
    yield farm_pb2.CompleteTasksRequest(job=job, log=log)
    for part in parts:
        yield farm_pb2.CompleteTasksRequest(part=part)
