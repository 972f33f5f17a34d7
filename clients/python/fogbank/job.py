"""Render jobs: following them, cancelling them, fetching their images."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Literal, TypeAlias

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
from fogbank.pixels import Tile
from fogbank.retry import Backoff
from fogbank.settings import RenderOptions, options_from_message
from fogbank.window import Window


class JobState(StrEnum):
    """Where a job stands."""

    UNKNOWN = "unknown"
    """A state that this version of the client does not know."""

    QUEUED = "queued"
    """Waiting for its scene to be loaded or for a thread."""

    RUNNING = "running"
    """Being rendered."""

    PAUSED = "paused"
    """Held by `Job.pause`."""

    SUCCEEDED = "succeeded"
    """Ended; the image can be fetched."""

    FAILED = "failed"
    """Ended with an error."""

    CANCELLED = "cancelled"
    """Ended by a client, or with the embedded server that it was made on."""


STATES: dict[int, JobState] = {
    render_pb2.JOB_STATE_QUEUED: JobState.QUEUED,
    render_pb2.JOB_STATE_RUNNING: JobState.RUNNING,
    render_pb2.JOB_STATE_PAUSED: JobState.PAUSED,
    render_pb2.JOB_STATE_SUCCEEDED: JobState.SUCCEEDED,
    render_pb2.JOB_STATE_FAILED: JobState.FAILED,
    render_pb2.JOB_STATE_CANCELLED: JobState.CANCELLED,
}
ENDED_STATES = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED})


Priority: TypeAlias = Literal["interactive", "normal", "background"]
PRIORITIES: dict[Priority, render_pb2.JobPriority.ValueType] = {
    "interactive": render_pb2.JOB_PRIORITY_INTERACTIVE,
    "normal": render_pb2.JOB_PRIORITY_NORMAL,
    "background": render_pb2.JOB_PRIORITY_BACKGROUND,
}

Phase: TypeAlias = Literal["filling", "rendering"]
_PHASES: dict[int, Phase] = {
    render_pb2.JOB_PHASE_FILLING: "filling",
    render_pb2.JOB_PHASE_RENDERING: "rendering",
}


@dataclass(frozen=True)
class TrueError:
    """Distance to a reference image.

    A pixel's relative error is the root of the mean over its channels of (image - reference)^2 / (m^2 + 0.01), with m
    the reference's mean over 5 x 5 pixels around it.
    """

    relative_mse: float
    """Mean of the squares, without the largest 0.1 % of the pixels."""

    median: float
    """Median over the pixels."""

    percentile_99: float
    """99th percentile over the pixels."""


@dataclass(frozen=True)
class ErrorReport:
    """A job's image as it was when a pass was complete.

    Shares of the error are root mean squares over the pixels of e / (L + M / 10): e the share in the pixel's
    luminance, L its luminance, M the mean of L; without the largest 0.1 % of the pixels.
    """

    elapsed_seconds: float
    """Wall-clock seconds since the job's first task was begun."""

    cpu_seconds: float
    """CPU seconds of the worker threads until then."""

    samples_per_pixel: int
    """Samples per pixel."""

    records: int
    """Records that the job could read: reused and new ones."""

    epoch: int
    """The cache's epoch."""

    estimated_error: float | None
    """The root of noise^2 + bias^2; None while the noise is unknown."""

    noise: float | None
    """Share of the samples' noise, which falls with every pass; None with one sample per pixel or a black image."""

    bias: float
    """Share of the records, their extrapolation and their own noise, which falls with more records; 0 without cache."""

    true_error: TrueError | None
    """Distance to the reference image; None without one."""

    @classmethod
    def from_message(cls, message: render_pb2.ErrorReport) -> ErrorReport:
        """The report of a wire message."""
        true_error = None
        if message.HasField("true_error"):
            true_error = TrueError(
                message.true_error.relative_mse, message.true_error.median, message.true_error.percentile_99
            )
        return cls(
            elapsed_seconds=message.elapsed_seconds,
            cpu_seconds=message.cpu_seconds,
            samples_per_pixel=message.samples_per_pixel,
            records=message.records,
            epoch=message.epoch,
            estimated_error=message.estimated_error if message.HasField("estimated_error") else None,
            noise=message.noise if message.HasField("noise") else None,
            bias=message.bias,
            true_error=true_error,
        )


@dataclass(frozen=True)
class Progress:
    """How far a job is."""

    passes_done: int
    """Complete passes."""

    passes_total: int | None
    """Passes in all; None while a time budget leaves it open."""

    samples_per_pixel_done: int
    """Samples per pixel in complete passes."""

    fraction: float
    """Share of the work that is done, 0 to 1."""

    rays: int
    """Rays traced."""

    rays_per_second: float
    """Of the last seconds."""

    elapsed_seconds: float
    """Since the job's first tile was begun."""

    eta_seconds: float | None
    """Estimated seconds left; None while unknown."""

    phase: Phase | None
    """Whether records or pixels are being made; None while it is not running."""

    records_reused: int
    """Records that were in the cache when the job began, of components that it needs."""

    records_new: int
    """Records that it has made."""

    epoch: int
    """The cache's epoch that passes are rendered with."""

    estimated_error: float | None
    """Of the image after the last complete pass, see `ErrorReport`; None while unknown."""

    noise: float | None
    """Share of `estimated_error` that comes from the samples; None while unknown."""

    bias: float | None
    """Share of `estimated_error` that comes from the records; None before the first pass."""

    true_error: TrueError | None
    """Distance to the reference image; None without one."""

    paused: bool
    """Held by `Job.pause`."""

    @classmethod
    def from_message(cls, message: render_pb2.Progress) -> Progress:
        """The progress of a wire message."""
        report = ErrorReport.from_message(message.report) if message.HasField("report") else None
        return cls(
            passes_done=message.passes_done,
            passes_total=message.passes_total or None,
            samples_per_pixel_done=message.samples_per_pixel_done,
            fraction=message.fraction,
            rays=message.rays,
            rays_per_second=message.rays_per_second,
            elapsed_seconds=message.elapsed_seconds,
            eta_seconds=message.eta_seconds if message.HasField("eta_seconds") else None,
            phase=_PHASES.get(message.phase),
            records_reused=message.records_reused,
            records_new=message.records_new,
            epoch=message.epoch,
            estimated_error=report.estimated_error if report else None,
            noise=report.noise if report else None,
            bias=report.bias if report else None,
            true_error=report.true_error if report else None,
            paused=message.paused,
        )


@dataclass(frozen=True)
class RenderStatistics:
    """What a finished job took and brought."""

    window: Window
    """The part of the film that the image holds."""

    film_size: tuple[int, int]
    """Width and height of the whole film in pixels."""

    samples_per_pixel: int
    """Samples per pixel."""

    samples: int
    """Samples in all."""

    rays: int
    """Rays in all."""

    load_seconds: float
    """Wall-clock seconds of loading the scene for this job; 0 when it was in memory."""

    render_seconds: float
    """Wall-clock seconds from the first tile to the last, without loading and without encoding the file."""

    render_cpu_seconds: float
    """CPU seconds of the worker threads on this job's tiles."""

    relative_noise: float | None
    """Root mean square of the pixels' estimated standard errors divided by the image's mean; None if unknown."""

    invalid_samples: int
    """Samples that were not finite or were negative, and were taken as black: a bug of the server if not 0."""

    cache: str | None
    """The cache that it used, "caches/{fingerprint}"; None for integrators without one."""

    records_reused: int
    """Records that were in the cache when the job began, of components that it needs."""

    records_new: int
    """Records that it made."""

    epoch: int
    """The cache's epoch that the image was rendered with."""

    estimated_error: float | None
    """Of the image, see `ErrorReport`; None if unknown."""

    noise: float | None
    """Share of `estimated_error` that comes from the samples; None if unknown."""

    bias: float | None
    """Share of `estimated_error` that comes from the records; None if unknown."""

    true_error: TrueError | None
    """Distance to the reference image; None without one."""

    history: list[ErrorReport]
    """Error against run time: a report for each pass; of very many passes some."""

    @classmethod
    def from_message(cls, message: render_pb2.JobResult) -> RenderStatistics:
        """The statistics of a wire message."""
        history = [ErrorReport.from_message(report) for report in message.history]
        last = history[-1] if history else None
        return cls(
            window=Window.from_message(message.window),
            film_size=(message.film_width, message.film_height),
            samples_per_pixel=message.samples_per_pixel,
            samples=message.samples,
            rays=message.rays,
            load_seconds=message.load_seconds,
            render_seconds=message.render_seconds,
            render_cpu_seconds=message.render_cpu_seconds,
            relative_noise=message.relative_noise if message.HasField("relative_noise") else None,
            invalid_samples=message.invalid_samples,
            cache=message.cache or None,
            records_reused=message.records_reused,
            records_new=message.records_new,
            epoch=message.epoch,
            estimated_error=last.estimated_error if last else None,
            noise=last.noise if last else None,
            bias=last.bias if last else None,
            true_error=last.true_error if last else None,
            history=history,
        )


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
