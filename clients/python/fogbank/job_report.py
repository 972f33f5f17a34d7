"""What a job tells of itself: its state, its progress, its errors, its figures."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, Literal, TypeAlias

from fogbank._generated.v1 import render_pb2
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
    """Share of the records, their extrapolation and their own noise, which falls with more records; of photon beams, of
    their blur, which falls with more samples; else 0."""

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
class ErrorFigures:
    """What is known about the error of a job's image after its last complete pass."""

    estimated_error: float | None
    """See `ErrorReport`; None while unknown."""

    noise: float | None
    """Share of `estimated_error` that comes from the samples; None while unknown."""

    bias: float | None
    """Share of `estimated_error` that comes from records or blur; None before the first pass."""

    true_error: TrueError | None
    """Distance to the reference image; None without one."""

    @staticmethod
    def after(report: ErrorReport | None) -> dict[str, Any]:
        """The fields by name, as the last report has them."""
        return {item.name: getattr(report, item.name, None) for item in fields(ErrorFigures)}


@dataclass(frozen=True)
class Progress(ErrorFigures):
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
            **ErrorFigures.after(report),
            paused=message.paused,
        )


@dataclass(frozen=True)
class RenderStatistics(ErrorFigures):
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

    history: list[ErrorReport]
    """Error against run time: a report for each pass; of very many passes some."""

    @classmethod
    def from_message(cls, message: render_pb2.JobResult) -> RenderStatistics:
        """The statistics of a wire message."""
        history = [ErrorReport.from_message(report) for report in message.history]
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
            **ErrorFigures.after(history[-1] if history else None),
            history=history,
        )
