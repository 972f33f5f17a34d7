"""Progress of a comparison or reference: a bar with the time left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fogbank_cli.output import Output, duration
from fogbank_cli.progress_bar import ProgressBar

if TYPE_CHECKING:
    from fogbank.comparison.runner import ComparisonProgress


class ComparisonBar(ProgressBar):
    """A bar on a terminal; JSON events with `--json`; else a line for each step."""

    def __init__(self, output: Output) -> None:
        """The bar appears with the first report."""
        super().__init__("starting", hidden=output.as_json)
        self._output = output

    def progress(self, progress: ComparisonProgress) -> None:
        """It is this far."""
        self._output.event("progress", **vars(progress))
        left = "" if progress.eta_seconds is None else f"{duration(progress.eta_seconds)} left"
        if self.drawn:
            self.update(progress.doing, progress.fraction, left)
        elif not self._output.as_json:
            self._output.note(f"{100.0 * progress.fraction:.0f} %: {progress.doing}, {left}")
