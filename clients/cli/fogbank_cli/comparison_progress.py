"""Progress of a comparison or reference: a bar with the time left."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from fogbank_cli.output import Output, duration

if TYPE_CHECKING:
    from fogbank.comparison.runner import ComparisonProgress


class ProgressBar:
    """A bar on a terminal; JSON events with `--json`; else a line for each step."""

    def __init__(self, output: Output) -> None:
        """The bar appears with the first report."""
        self._output = output
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]}"),
            console=Console(stderr=True),
            transient=True,
            disable=output.as_json,
        )
        self._task = self._bar.add_task("starting", total=1.0, left="")

    def __enter__(self) -> Self:
        """Begins to draw."""
        if self._bar.console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Removes the bar."""
        if self._bar.live.is_started:
            self._bar.stop()

    def progress(self, progress: ComparisonProgress) -> None:
        """It is this far."""
        self._output.event("progress", **vars(progress))
        left = "" if progress.eta_seconds is None else f"{duration(progress.eta_seconds)} left"
        if self._bar.live.is_started:
            self._bar.update(
                self._task, description=progress.doing, completed=progress.fraction, left=left, refresh=True
            )
        elif not self._output.as_json:
            self._output.note(f"{100.0 * progress.fraction:.0f} %: {progress.doing}, {left}")
