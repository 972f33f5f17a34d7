"""`fogbank sweep`: frames along a camera path, from one cache."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import click
import fogbank
from fogbank import RenderOptions

from fogbank_cli.camera_paths import camera_path_options, path_cameras
from fogbank_cli.filling import fill
from fogbank_cli.image_output import error_summary, exposure_option, records_summary
from fogbank_cli.output import Output, duration
from fogbank_cli.parameter_types import Bands, FramePatternType, RangeType
from fogbank_cli.render import load_scene
from fogbank_cli.render_options import frame_options, part_options, take_part
from fogbank_cli.session import Session, json_option, loading_options, openjd_option, pass_session
from fogbank_cli.watching import follow


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("-o", "--output", "pattern", type=FramePatternType(), required=True, help=".exr or .png of each frame.")
@camera_path_options
@click.option(
    "--fill-first/--no-fill-first",
    default=None,
    help="Make the records of all frames first, and render at that epoch; default with a cache.",
)
@click.option("--resume", is_flag=True, help="Skip frames whose file is there.")
@click.option("--only", type=RangeType(), help="Render frames A to B alone, counted from 0; records are made for all.")
@click.option(
    "--in-flight", type=click.IntRange(1), default=2, show_default=True, help="Jobs that the server has at once."
)
@frame_options
@part_options
@loading_options
@exposure_option
@openjd_option
@json_option
@pass_session
def sweep(
    session: Session,
    /,
    scene: Path,
    pattern: str,
    cameras: Path | None,
    frames: int | None,
    orbit: int | None,
    target: tuple[float, float, float] | None,
    degrees: float | None,
    fill_first: bool | None,
    resume: bool,
    only: tuple[int, int] | None,
    in_flight: int,
    bands: Bands | None,
    cache_file: Path | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    exposure: float,
    **options: Unpack[RenderOptions],
) -> None:
    """Render SCENE along a camera path, and write a numbered image for each frame.

    The records that all frames need are made first. Then every frame is rendered at that one epoch of the cache, so
    that none of them depends on the order of the others, and the sequence does not flicker while records are added.
    Frames are whole or not there: after an interruption --resume makes the missing ones, the same to the bit.
    """
    output = session.output
    with session.connect() as service:
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        path = path_cameras(loaded, cameras=cameras, frames=frames, orbit=orbit, target=target, degrees=degrees)
        integrator = options.get("integrator") or loaded.defaults.integrator
        take_part(loaded, bands, options)
        if cache_file is not None:
            loaded.cache.import_(cache_file)
        if fill_first is None:
            fill_first = integrator in service.capabilities.cached_integrators and options.get("records") != 0
        first, last = (0, len(path) - 1) if only is None else only
        if last >= len(path):
            raise click.UsageError(f"--only: there are {len(path)} frames, the last one is {len(path) - 1}")
        todo = [
            Frame(number, Path(pattern % number), camera)
            for number, camera in enumerate(path)
            if first <= number <= last and not (resume and Path(pattern % number).is_file())
        ]
        Path(pattern % 0).parent.mkdir(parents=True, exist_ok=True)
        totals = Totals(frames=last - first + 1, skipped=last - first + 1 - len(todo))
        if fill_first and todo:
            report = fill(loaded.cache, path, output, fill_options(options))
            totals.fill(report)
            options["epoch"] = report.epoch

        def start(frame_settings: RenderOptions) -> fogbank.Job:
            return loaded.render(**frame_settings)

        render_frames(start, todo, options, output, totals, in_flight=in_flight, exposure=exposure)
    output.event("done", **vars(totals))
    output.text(totals.summary())


@dataclass(frozen=True)
class Frame:
    """One picture of the sequence."""

    number: int
    path: Path
    camera: Mapping[str, Any]


@dataclass
class Totals:
    """What a sweep took and brought."""

    frames: int
    skipped: int
    rendered: int = 0
    records_reused: int = 0
    records_new: int = 0
    epoch: int = 0
    fill_seconds: float = 0.0
    render_seconds: float = 0.0
    render_cpu_seconds: float = 0.0
    rays: int = 0

    def fill(self, report: fogbank.FillProgress) -> None:
        """Counts a fill."""
        self.records_reused = report.records_reused
        self.records_new += report.records_new
        self.epoch = report.epoch
        self.fill_seconds = report.elapsed_seconds
        self.rays += report.rays

    def frame(self, statistics: fogbank.RenderStatistics) -> None:
        """Counts a frame."""
        if self.rendered == 0 and self.fill_seconds == 0.0:
            self.records_reused = statistics.records_reused
        self.rendered += 1
        self.records_new += statistics.records_new
        self.epoch = max(self.epoch, statistics.epoch)
        self.render_seconds += statistics.render_seconds
        self.render_cpu_seconds += statistics.render_cpu_seconds
        self.rays += statistics.rays

    def summary(self) -> str:
        """The last line for people."""
        parts = [f"{self.rendered} frames rendered"]
        if self.skipped:
            parts.append(f"{self.skipped} were there")
        if self.records_reused + self.records_new > 0:
            parts.append(records_summary(self.records_reused, self.records_new))
        if self.fill_seconds > 0.0:
            parts.append(f"filled in {duration(self.fill_seconds)}")
        parts.append(f"{duration(self.render_cpu_seconds)} of CPU time for the frames")
        return ", ".join(parts)


def fill_options(options: RenderOptions) -> RenderOptions:
    """The options of the frames without those that a fill has no use for: a time is each frame's own."""
    chosen = RenderOptions(**options)
    for name in ("time_budget", "aovs", "variance"):
        chosen.pop(name, None)  # type: ignore[misc]
    return chosen


def render_frames(
    start: Callable[[RenderOptions], fogbank.Job],
    frames: Sequence[Frame],
    options: RenderOptions,
    output: Output,
    totals: Totals,
    *,
    in_flight: int,
    exposure: float,
) -> None:
    """Renders the frames in their order, a few jobs ahead; cancels what is left when one of them fails.

    Args:
        start: starts a job with these options.
        frames: the frames.
        options: what they share.
        output: where events and results go.
        totals: counts the frames.
        in_flight: jobs at once.
        exposure: stops, for .png files.
    """
    waiting = deque(frames)
    running: deque[tuple[Frame, fogbank.Job]] = deque()
    try:
        while waiting or running:
            while waiting and len(running) < in_flight:
                frame = waiting.popleft()
                job = start(RenderOptions(**{**options, "camera": frame.camera}))
                output.event("job", frame=frame.number, job=job.name, settings=job.settings)
                running.append((frame, job))
            frame, job = running[0]
            follow(job, output, on_tile=None, on_interrupt="cancel")
            if job.error is not None:
                raise job.error
            job.result().save(frame.path, exposure=exposure)
            running.popleft()
            _report_frame(frame, job, output, totals)
    finally:
        for _, job in running:
            job.cancel()


def _report_frame(frame: Frame, job: fogbank.Job, output: Output, totals: Totals) -> None:
    statistics = job.statistics
    if statistics is None:
        raise fogbank.InternalError(f"{job.name} succeeded and has no result")
    totals.frame(statistics)
    output.event("frame", frame=frame.number, image=frame.path, job=job.name, camera=frame.camera, **vars(statistics))
    parts = [f"rendered in {duration(statistics.render_seconds)}", error_summary(statistics)]
    if statistics.cache is not None:
        parts.append(records_summary(statistics.records_reused, statistics.records_new))
    output.text(f"{frame.path}: {', '.join(parts)}")
