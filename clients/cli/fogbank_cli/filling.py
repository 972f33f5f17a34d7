"""Filling a cache, with its progress shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import fogbank
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from fogbank_cli.image_output import records_summary
from fogbank_cli.output import Output, duration
from fogbank_cli.watching import Interrupts


def fill(
    cache: fogbank.SceneCache,
    cameras: Sequence[Mapping[str, Any]],
    output: Output,
    options: fogbank.RenderOptions,
) -> fogbank.FillProgress:
    """Makes the records that the cameras need; Ctrl-C ends it, and what is made stays. Returns the last report."""
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
            for report in cache.fill_events(cameras, **options):
                output.event("fill", cache=cache.name, **vars(report))
                figures = f"camera {report.cameras_done}/{report.cameras_total}, {report.records_new} new records"
                output.progress(report.fraction, f"filling the cache: {figures}")
                bar.update(task, completed=report.fraction, figures=figures, refresh=bar.live.is_started)
                if interrupts.count > 0:
                    raise KeyboardInterrupt
        finally:
            if bar.live.is_started:
                bar.stop()
    output.text(
        f"{cache.name[:19]}: filled for {report.cameras_total} camera{'s' if report.cameras_total != 1 else ''} in"
        f" {duration(report.elapsed_seconds)}, {records_summary(report.records_reused, report.records_new)}"
    )
    return report
