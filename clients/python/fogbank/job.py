"""Render jobs: following them, cancelling them, fetching their images."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import TypeAlias

import grpc
from google.protobuf.timestamp_pb2 import Timestamp

from fogbank import exr
from fogbank._generated.v1 import render_pb2
from fogbank.channel import Connection
from fogbank.download import FileChunk, download
from fogbank.errors import (
    CallCancelledError,
    DataLossError,
    DeadlineExceededError,
    FogbankError,
    UnavailableError,
    job_error,
)
from fogbank.image import Image
from fogbank.job_report import (
    ENDED_STATES,
    PRIORITIES,
    STATES,
    JobState,
    Priority,
    Progress,
    RenderStatistics,
)
from fogbank.pixels import Tile
from fogbank.retry import Backoff
from fogbank.settings import RenderOptions, options_from_message
from fogbank.window import Window

JobEvent: TypeAlias = "Job | Tile | Progress"
"""The job itself stands for a change of its state: first, after each re-attachment, and last when it has ended."""


class Job:
    """A render on the server. It goes on there whatever happens to this object, and when the server is started again;
    only `cancel` ends it early."""

    def __init__(self, connection: Connection, message: render_pb2.Job) -> None:
        """Made by `Scene.render` and `Service.job`, not by users."""
        self._connection = connection
        self._message = message

    def __repr__(self) -> str:
        """Name and state."""
        return f"<fogbank.Job {self.name} {self.state}>"

    @property
    def name(self) -> str:
        """The name on the server, "jobs/{id}"."""
        return self._message.name

    @property
    def scene_name(self) -> str:
        """The scene that it renders, "scenes/{fingerprint}"."""
        return self._message.scene

    @property
    def state(self) -> JobState:
        """Where it stood when this client last heard of it."""
        return STATES.get(self._message.state, JobState.UNKNOWN)

    @property
    def ended(self) -> bool:
        """True when it succeeded, failed or was cancelled, as far as this client has heard."""
        return self.state in ENDED_STATES

    @property
    def settings(self) -> RenderOptions:
        """The effective settings, every default filled in by the server."""
        return options_from_message(self._message.settings)

    @property
    def progress(self) -> Progress:
        """How far it was when this client last heard of it."""
        return Progress.from_message(self._message.progress)

    @property
    def statistics(self) -> RenderStatistics | None:
        """What it took and brought; None before it has succeeded."""
        return RenderStatistics.from_message(self._message.result) if self._message.HasField("result") else None

    @property
    def priority(self) -> Priority:
        """Its urgency among the jobs of the same user."""
        return next((name for name, value in PRIORITIES.items() if value == self._message.priority), "normal")

    @property
    def restarts(self) -> int:
        """How often the server was started again while the job had not ended."""
        return self._message.restarts

    @property
    def create_time(self) -> datetime:
        """When it was created, UTC."""
        return self._message.create_time.ToDatetime(UTC)

    @property
    def start_time(self) -> datetime | None:
        """When its first tile was begun, UTC; None before."""
        return self._time("start_time", self._message.start_time)

    @property
    def end_time(self) -> datetime | None:
        """When it ended, UTC; None before."""
        return self._time("end_time", self._message.end_time)

    @property
    def error(self) -> FogbankError | None:
        """Why it failed or was cancelled; None for any other state."""
        if self.state not in (JobState.FAILED, JobState.CANCELLED):
            return None
        return job_error(self.state is JobState.CANCELLED, self._message.error)

    def refresh(self) -> Job:
        """Asks the server how the job is now, and returns this object."""
        response = self._connection.call(lambda stubs: stubs.render.GetJob, render_pb2.GetJobRequest(name=self.name))
        self._message = response.job
        return self

    def cancel(self) -> None:
        """Cancels the job; does not wait for its end. A job that has ended stays as it is."""
        response = self._connection.call(
            lambda stubs: stubs.render.CancelJob, render_pb2.CancelJobRequest(name=self.name)
        )
        self._message = response.job

    def pause(self) -> None:
        """Holds the job until `resume`, over restarts of the server, too. A job that has ended stays as it is."""
        response = self._connection.call(
            lambda stubs: stubs.render.PauseJob, render_pb2.PauseJobRequest(name=self.name)
        )
        self._message = response.job

    def resume(self) -> None:
        """Goes on with a paused job; any other stays as it is."""
        response = self._connection.call(
            lambda stubs: stubs.render.ResumeJob, render_pb2.ResumeJobRequest(name=self.name)
        )
        self._message = response.job

    def events(
        self, *, tiles: bool = True, update_interval: float | None = None, timeout: float | None = None
    ) -> Iterator[JobEvent]:
        """Yields what happens to the job until it has ended, however it ends.

        A broken connection is taken up again where it broke. Dropping the generator ends the stream, not the job.

        Args:
            tiles: whether pixels are wanted. A tile replaces what came before in its window; a slow reader gets the
                newest state of each tile, not every pass.
            update_interval: least seconds between two updates of one tile, if more than the job's own.
            timeout: seconds after which DeadlineExceededError is raised; None for no limit.
        """
        for response in self._watch(tiles=tiles, update_interval=update_interval, timeout=timeout):
            kind = response.WhichOneof("event")
            if kind == "tile":
                yield _tile(response.tile)
            elif kind == "progress":
                self._message.progress.CopyFrom(response.progress)
                yield Progress.from_message(response.progress)
            elif kind == "snapshot":
                self._message = response.snapshot.job
                yield self
            elif kind == "ended":
                self._message = response.ended.job
                yield self

    def tiles(self, *, update_interval: float | None = None) -> Iterator[Tile]:
        """Yields tiles, float32 arrays (h, w, 3) of linear RGB with `window` and `pass_`, until the job has succeeded.

        Written over each other in this order they give, in the end, the pixels of `result()`. Raises JobFailedError
        or JobCancelledError when the job ends otherwise. See `events` for `update_interval` and broken connections.
        """
        for event in self.events(update_interval=update_interval):
            if isinstance(event, Tile):
                yield event
        self._raise_unless_succeeded()

    def wait(self, *, timeout: float | None = None) -> Job:
        """Waits until the job has ended, however it ends, and returns this object.

        Args:
            timeout: seconds after which DeadlineExceededError is raised; None for no limit.
        """
        if not self.ended:
            for _ in self.events(tiles=False, timeout=timeout):
                pass
        return self

    def result(self, *, timeout: float | None = None) -> Image:
        """Waits for the job's end and fetches its image.

        Raises JobFailedError or JobCancelledError when there is none, DeadlineExceededError when the job has not
        ended after `timeout` seconds, DataLossError when the image arrives damaged.
        """
        self.wait(timeout=timeout)
        self._raise_unless_succeeded()
        return Image.from_exr(self._download(), sha256=self._message.result.image_sha256)

    def _raise_unless_succeeded(self) -> None:
        error = self.error
        if error is not None:
            raise error

    def _watch(
        self, *, tiles: bool, update_interval: float | None, timeout: float | None
    ) -> Iterator[render_pb2.WatchJobResponse]:
        deadline = None if timeout is None else time.monotonic() + timeout
        backoff = Backoff(self._connection.retry_policy)
        revision = 0
        while True:
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0.0:
                raise DeadlineExceededError(f"{self.name} has not ended after {timeout} s")
            call = self._connection.stubs.render.WatchJob(
                render_pb2.WatchJobRequest(
                    name=self.name,
                    since_revision=revision,
                    update_interval_seconds=update_interval,
                    without_tiles=not tiles,
                ),
                timeout=left,
            )
            try:
                for response in call:
                    revision = max(revision, response.revision)
                    kind = response.WhichOneof("event")
                    if kind != "snapshot":
                        backoff.progressed()
                    yield response
                    if kind == "ended":
                        return
                error: FogbankError = UnavailableError(f"the stream of {self.name} broke off before the job's end")
            except grpc.RpcError as rpc_error:
                error = self._connection.translate(rpc_error)
            finally:
                # Also reached when the generator is dropped; after the regular end it does nothing.
                call.cancel()
            if deadline is not None and isinstance(error, DeadlineExceededError):
                continue
            if isinstance(error, CallCancelledError):
                # Not by this client, which leaves by way of GeneratorExit: servers cut streams that nobody reads.
                error = UnavailableError(f"the server ended the stream of {self.name}")
            self._connection.wait_or_raise(backoff, error)

    def _download(self) -> bytes:
        def chunks(offset: int) -> Iterator[FileChunk]:
            request = render_pb2.DownloadImageRequest(name=self.name, offset=offset)
            for response in self._connection.stubs.render.DownloadImage(request):
                yield FileChunk(response.size, response.sha256, response.offset, response.chunk)

        file = io.BytesIO()
        download(self._connection, chunks, file, f"the image of {self.name}")
        return file.getvalue()

    def _time(self, field: str, value: Timestamp) -> datetime | None:
        return value.ToDatetime(UTC) if self._message.HasField(field) else None  # type: ignore[arg-type]


def _tile(message: render_pb2.Tile) -> Tile:
    window = Window.from_message(message.window)
    decoded = exr.decode(message.exr)
    if decoded.window != window:
        raise DataLossError(f"a tile of {window} holds an EXR file of {decoded.window}")
    return Tile.create(
        decoded.pixels,
        window=window,
        pass_=getattr(message, "pass"),  # a keyword in Python
        samples_per_pixel=message.samples_per_pixel,
    )
