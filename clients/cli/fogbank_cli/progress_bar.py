"""A bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TaskProgressColumn, TextColumn


class ProgressBar:
    """Description, bar, percentage, details; drawn inside `with`, and gone after it."""

    def __init__(self, description: str, *columns: ProgressColumn, hidden: bool) -> None:
        """`columns` follow the details."""
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[details]}"),
            *columns,
            console=Console(stderr=True),
            transient=True,
            disable=hidden,
        )
        self._task = self._bar.add_task(description, total=1.0, details="")

    def __enter__(self) -> Self:
        """Begins to draw."""
        # Without a terminal rich would only print the last state of the bar.
        if self._bar.console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Removes the bar."""
        if self.drawn:
            self._bar.stop()

    @property
    def drawn(self) -> bool:
        """Whether anybody sees it."""
        return self._bar.live.is_started

    def describe(self, description: str) -> None:
        """Something else is done."""
        self._bar.update(self._task, description=description)

    def update(self, description: str, fraction: float, details: str) -> None:
        """This far, 0 to 1."""
        self._bar.update(self._task, description=description, completed=fraction, details=details, refresh=True)
