"""Filling a cache, with its progress shown."""

from __future__ import annotations

from collections.abc import Iterable

import fogbank
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from fogbank_cli.image_output import records_summary
from fogbank_cli.output import Output, duration
from fogbank_cli.watching import Interrupts


def fill(cache: str, reports: Iterable[fogbank.FillProgress], output: Output) -> fogbank.FillProgress:
    """Shows how a fill goes on; Ctrl-C ends it, and what is made stays.

    Args:
        cache: its name.
        reports: what `SceneCache.fill_events` gives, or `fogbank.farm.fill_events`.
        output: where it is shown.

    Returns: the last report.
    """
    bar = Progress(
        TextColumn("filling the cache"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[figures]}"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=output.as_json,
    )
    task = bar.add_task("", total=1.0, figures="")
    with Interrupts() as interrupts:
        if bar.console.is_terminal:
            bar.start()
        try:
            # The server reports several times a second, so a Ctrl-C is soon acted on.
            for report in reports:
                output.event("fill", cache=cache, **vars(report))
                figures = f"camera {report.cameras_done}/{report.cameras_total}, {report.records_new} new records"
                output.progress(report.fraction, f"filling the cache: {figures}")
                bar.update(task, completed=report.fraction, figures=figures, refresh=bar.live.is_started)
                if interrupts.count > 0:
                    raise KeyboardInterrupt
        finally:
            if bar.live.is_started:
                bar.stop()
    return report


def tell_filled(cache: str, report: fogbank.FillProgress, output: Output) -> None:
    """Says what a fill has made."""
    output.text(
        f"{cache[:19]}: filled for {report.cameras_total} camera{'s' if report.cameras_total != 1 else ''} in"
        f" {duration(report.elapsed_seconds)}, {records_summary(report.records_reused, report.records_new)}"
    )
