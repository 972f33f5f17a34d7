"""Following a job: progress for people or machines, live view, and what Ctrl-C means."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Literal, Self, TypeAlias

import fogbank
from rich.progress import TimeElapsedColumn

from fogbank_cli.output import Output, duration, quantity
from fogbank_cli.progress_bar import ProgressBar

# How soon a Ctrl-C is acted on while nothing else happens.
_POLL_SECONDS = 0.1

# A render that takes longer than this is worth lines about its progress in a log.
_LONG_SECONDS = 5.0


class Interrupts:
    """Counts Ctrl-C while a job is followed.

    Nothing is raised from within the handler: it could strike in the middle of an event's line.
    """

    def __init__(self) -> None:
        """None so far."""
        self.count = 0

    def __enter__(self) -> Self:
        """Takes over SIGINT."""
        self._previous = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Gives SIGINT back."""
        signal.signal(signal.SIGINT, self._previous)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.count += 1


class ProgressDisplay(ProgressBar):
    """A progress bar on a terminal; JSON events with `--json`; else a line for each tenth of a long render."""

    def __init__(self, output: Output) -> None:
        """The bar appears with the first report."""
        super().__init__("waiting", TimeElapsedColumn(), hidden=output.as_json)
        self._output = output
        self._tenths = 0

    def state(self, job: fogbank.Job) -> None:
        """The job is in another state."""
        self._output.event("state", job=job.name, state=str(job.state))
        self.describe(str(job.state))

    def progress(self, progress: fogbank.Progress) -> None:
        """The job is this far."""
        self._output.event("progress", **vars(progress))
        passes = f"pass {progress.passes_done}"
        if progress.passes_total is not None:
            passes += f"/{progress.passes_total}"
        if progress.phase == "filling":
            passes = "filling the cache"
        figures = [f"{progress.samples_per_pixel_done} spp", quantity(progress.rays_per_second, "rays/s")]
        if progress.records_reused + progress.records_new > 0:
            figures.append(f"{progress.records_new} new records")
        if progress.estimated_error is not None:
            figures.append(f"error {100.0 * progress.estimated_error:.2g} %")
        if progress.eta_seconds is not None:
            figures.append(f"{duration(progress.eta_seconds)} left")
        self._output.progress(progress.fraction, f"{passes}, {', '.join(figures)}")
        tenths = int(10.0 * progress.fraction)
        if not self.drawn and not self._output.as_json and tenths > self._tenths:
            self._tenths = tenths
            if progress.elapsed_seconds >= _LONG_SECONDS:
                self._output.note(f"{10 * tenths} %: {passes}, {', '.join(figures)}")
        self.update(passes, progress.fraction, ", ".join(figures))


def follow(
    job: fogbank.Job,
    output: Output,
    *,
    on_tile: Callable[[fogbank.Tile], None] | None,
    on_interrupt: Literal["cancel", "leave"],
) -> None:
    """Follows a job to its end, however it ends.

    Args:
        job: the job.
        output: where progress goes.
        on_tile: is handed every tile, in another thread; without it no pixels are asked for.
        on_interrupt: whether the first Ctrl-C cancels the job (the second one then stops waiting for its end), or
            leaves it alone.

    Raises KeyboardInterrupt when it was told to leave.
    """
    reports: _Reports = queue.Queue()
    left = threading.Event()
    _in_background(lambda: _report_events(job, reports, on_tile, left), reports)
    cancelled = False
    with Interrupts() as interrupts, ProgressDisplay(output) as display:
        try:
            while True:
                if interrupts.count > (1 if on_interrupt == "cancel" else 0):
                    raise KeyboardInterrupt
                if interrupts.count > 0 and not cancelled:
                    cancelled = True
                    output.event("cancelling", job=job.name)
                    output.note(f"cancelling {job.name}; press Ctrl-C again to leave without waiting")
                    _in_background(job.cancel, reports)
                try:
                    report = reports.get(timeout=_POLL_SECONDS)
                except queue.Empty:
                    continue
                if report is None:
                    return
                if isinstance(report, BaseException):
                    raise report
                if isinstance(report, fogbank.Progress):
                    display.progress(report)
                else:
                    display.state(report)
        finally:
            left.set()


# What the other threads tell the main one; None: the job has ended; an exception: something failed for good.
_Reports: TypeAlias = "queue.Queue[fogbank.Job | fogbank.Progress | BaseException | None]"


def _report_events(
    job: fogbank.Job, reports: _Reports, on_tile: Callable[[fogbank.Tile], None] | None, left: threading.Event
) -> None:
    for event in job.events(tiles=on_tile is not None):
        if left.is_set():
            return
        if not isinstance(event, fogbank.Tile):
            reports.put(event)
        elif on_tile is not None:
            on_tile(event)
    reports.put(None)


def _in_background(task: Callable[[], None], reports: _Reports) -> None:
    """Runs what may block in another thread, so that the main one always notices a Ctrl-C."""

    def run() -> None:
        try:
            task()
        except Exception as error:
            reports.put(error)

    threading.Thread(target=run, name="fogbank-follow", daemon=True).start()
