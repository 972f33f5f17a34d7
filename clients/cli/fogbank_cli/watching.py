"""Following a job: progress for people or machines, live view, and what Ctrl-C means."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Literal, Self

import fogbank
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from fogbank_cli.output import Output, duration, quantity
from fogbank_cli.tev import TevDisplay

# How soon a Ctrl-C is acted on while nothing else happens.
_POLL_SECONDS = 0.1


class Interrupts:
    """Ctrl-C while a job is followed: the first one is noted, the second one raises KeyboardInterrupt."""

    def __init__(self) -> None:
        """None so far."""
        self.noted = False

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
        if self.noted:
            raise KeyboardInterrupt
        self.noted = True


class ProgressDisplay:
    """A progress bar on a terminal; JSON events with `--json`; silent else."""

    def __init__(self, output: Output) -> None:
        """The bar appears with the first report."""
        self._output = output
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[figures]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
            disable=output.as_json,
        )
        self._task = self._bar.add_task("waiting", total=1.0, figures="")

    def __enter__(self) -> Self:
        """Begins to draw."""
        # Without a terminal rich would print the last state of the bar, which says nothing that the result does not.
        if self._bar.console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Removes the bar."""
        self._bar.stop()

    def state(self, job: fogbank.Job) -> None:
        """The job is in another state."""
        self._output.event("state", job=job.name, state=str(job.state))
        self._bar.update(self._task, description=str(job.state))

    def progress(self, progress: fogbank.Progress) -> None:
        """The job is this far."""
        self._output.event("progress", **vars(progress))
        passes = f"pass {progress.passes_done}"
        if progress.passes_total is not None:
            passes += f"/{progress.passes_total}"
        figures = [f"{progress.samples_per_pixel_done} spp", quantity(progress.rays_per_second, "rays/s")]
        if progress.eta_seconds is not None:
            figures.append(f"{duration(progress.eta_seconds)} left")
        self._bar.update(
            self._task, description=passes, completed=progress.fraction, figures=", ".join(figures), refresh=True
        )


def follow(
    job: fogbank.Job, output: Output, *, tev: TevDisplay | None, on_interrupt: Literal["cancel", "leave"]
) -> None:
    """Follows a job to its end, however it ends.

    Args:
        job: the job.
        output: where progress goes.
        tev: shows tiles; without it no pixels are asked for.
        on_interrupt: whether the first Ctrl-C cancels the job (the second one then stops waiting for its end), or
            leaves it alone.

    Raises KeyboardInterrupt when it was told to leave.
    """
    with Interrupts() as interrupts, ProgressDisplay(output) as display, _events(job, tiles=tev is not None) as events:
        cancelled = False
        while True:
            if interrupts.noted and not cancelled:
                if on_interrupt == "leave":
                    raise KeyboardInterrupt
                cancelled = True
                output.event("cancelling", job=job.name)
                output.note(f"cancelling {job.name}; press Ctrl-C again to leave without waiting")
                job.cancel()
            try:
                event = events.get(timeout=_POLL_SECONDS)
            except queue.Empty:
                continue
            if event is None:
                return
            if isinstance(event, BaseException):
                raise event
            if isinstance(event, fogbank.Tile):
                if tev is not None:
                    tev.show(event)
            elif isinstance(event, fogbank.Progress):
                display.progress(event)
            else:
                display.state(event)


@contextmanager
def _events(job: fogbank.Job, *, tiles: bool) -> Iterator[queue.Queue[fogbank.JobEvent | BaseException | None]]:
    """The job's events, read by another thread: signal handlers can't run while the main thread is inside gRPC.

    The queue ends with None, or with the exception that ended the stream.
    """
    # Bounded: a slow viewer then holds back the stream, and the server sends newer tiles instead.
    events: queue.Queue[fogbank.JobEvent | BaseException | None] = queue.Queue(maxsize=16)
    left = threading.Event()

    def put(event: fogbank.JobEvent | BaseException | None) -> None:
        while not left.is_set():
            try:
                events.put(event, timeout=_POLL_SECONDS)
                return
            except queue.Full:
                continue

    def read() -> None:
        try:
            for event in job.events(tiles=tiles):
                put(event)
                if left.is_set():
                    return
            put(None)
        except BaseException as error:
            put(error)

    threading.Thread(target=read, name="fogbank-events", daemon=True).start()
    try:
        yield events
    finally:
        left.set()
