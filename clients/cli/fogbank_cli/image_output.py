"""Options and steps shared by the commands that follow a job and write its image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, ParamSpec, TypeVar

import click
import fogbank

from fogbank_cli.output import Output, duration, quantity
from fogbank_cli.parameter_types import HostPortType
from fogbank_cli.tev import DEFAULT_PORT, TevDisplay
from fogbank_cli.watching import follow

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def watch_tev_option(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--watch-tev`."""
    return click.option(
        "--watch-tev",
        type=HostPortType(DEFAULT_PORT),
        help=f"Show tiles as they come in a running tev (port {DEFAULT_PORT} by default).",
    )(command)


def exposure_option(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--exposure`."""
    return click.option(
        "--exposure", type=float, default=0.0, show_default=True, help="Stops, for .png only: times 2^exposure."
    )(command)


def follow_and_save(
    job: fogbank.Job,
    output: Output,
    paths: Sequence[Path],
    *,
    tev_address: tuple[str, int] | None,
    exposure: float,
    on_interrupt: Literal["cancel", "leave"],
    load_seconds: float,
) -> None:
    """Follows a job, writes its image to `paths`, and prints the last event or line.

    Args:
        job: the job.
        output: where events and the result go.
        paths: .exr and .png files, perhaps none.
        tev_address: host and port of a tev that shows the tiles.
        exposure: stops, for .png files.
        on_interrupt: what the first Ctrl-C does to the job.
        load_seconds: wall-clock seconds that loading the scene took before the job was created.

    Raises JobFailedError or JobCancelledError when there is no image.
    """
    tev = None if tev_address is None else _open_tev(job, output, tev_address)
    try:
        follow(job, output, on_tile=None if tev is None else tev.show, on_interrupt=on_interrupt)
    finally:
        if tev is not None:
            if tev.failure is not None:
                output.note(f"tev is gone: {tev.failure}")
            tev.close()
    if job.error is not None:
        raise job.error
    if paths:
        image = job.result()
        for path in paths:
            image.save(path, exposure=exposure)
    statistics = job.statistics
    if statistics is None:
        raise fogbank.InternalError(f"{job.name} succeeded and has no result")
    if statistics.invalid_samples:
        output.note(
            f"warning: {statistics.invalid_samples} samples were not valid and taken as black; please report it"
        )
    output.event(
        "done",
        image=paths[0] if paths else None,
        images=list(paths),
        job=job.name,
        scene=job.scene_name,
        settings=job.settings,
        **vars(statistics) | {"load_seconds": load_seconds + statistics.load_seconds},
    )
    output.text(_summary(job, statistics, paths))


def _open_tev(job: fogbank.Job, output: Output, address: tuple[str, int]) -> TevDisplay | None:
    try:
        return TevDisplay(*address, title=job.name, film_size=_film_size(job))
    except OSError as error:
        output.note(f"no tev at {address[0]}:{address[1]} ({error.strerror or error}); rendering without it")
        return None


def _film_size(job: fogbank.Job) -> tuple[int, int]:
    width, height = job.settings.get("size") or (None, None)
    if width is None or height is None:
        raise fogbank.InternalError(f"the settings of {job.name} lack the film's size")
    return width, height


def _summary(job: fogbank.Job, statistics: fogbank.RenderStatistics, paths: Sequence[Path]) -> str:
    """Where the image is and how good."""
    rays_per_second = statistics.rays / statistics.render_seconds if statistics.render_seconds > 0 else 0.0
    parts = [
        f"{statistics.window.width}x{statistics.window.height}",
        f"{statistics.samples_per_pixel} spp",
        f"rendered in {duration(statistics.render_seconds)}",
        quantity(rays_per_second, "rays/s"),
        error_summary(statistics),
    ]
    if statistics.cache is not None:
        parts.append(records_summary(statistics.records_reused, statistics.records_new))
    where = ", ".join(str(path) for path in paths) or job.name
    return f"{where}: {', '.join(parts)}"


def error_summary(statistics: fogbank.RenderStatistics) -> str:
    """What is known about the error of an image."""
    if statistics.cache is None and not statistics.bias:
        noise = statistics.relative_noise
        text = "noise unknown" if noise is None else f"estimated noise {100.0 * noise:.2g} %"
    elif statistics.estimated_error is None or statistics.noise is None or statistics.bias is None:
        text = "error unknown"
    else:
        what = "blur" if statistics.cache is None else "cache"
        text = (
            f"estimated error {100.0 * statistics.estimated_error:.2g} %"
            f" (noise {100.0 * statistics.noise:.2g} %, {what} {100.0 * statistics.bias:.2g} %)"
        )
    if statistics.true_error is not None:
        text += (
            f", true error: median {100.0 * statistics.true_error.median:.2g} %,"
            f" 99th percentile {100.0 * statistics.true_error.percentile_99:.2g} %"
        )
    return text


def records_summary(reused: int, new: int) -> str:
    """How many records were there, and how many had to be made."""
    return f"{reused} records reused, {new} new"
