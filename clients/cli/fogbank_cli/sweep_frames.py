"""Frames along a camera path: the part of `sweep` and `farm sweep` that they share."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, Unpack

import click
import fogbank
from fogbank import RenderOptions

from fogbank_cli.camera_paths import camera_path_options, path_cameras
from fogbank_cli.filling import fill, tell_filled
from fogbank_cli.image_output import error_summary, exposure_option, records_summary
from fogbank_cli.option_groups import grouped
from fogbank_cli.output import Output, duration
from fogbank_cli.parameter_types import FramePatternType
from fogbank_cli.render import load_scene
from fogbank_cli.render_options import frame_options
from fogbank_cli.session import loading_options
from fogbank_cli.watching import follow

Result = TypeVar("Result")

Fill = Literal["first", "ahead", "none"]


@dataclass(frozen=True)
class SweepChoice:
    """What the options name."""

    scene: Path
    pattern: str
    cameras: Path | None
    frames: int | None
    orbit: int | None
    target: tuple[float, float, float] | None
    degrees: float | None
    fill: Fill | None
    resume: bool
    in_flight: int
    parameters: tuple[tuple[str, str], ...]
    lenient: bool
    root: Path | None
    exposure: float

    def load(self, service: fogbank.Service, output: Output) -> fogbank.Scene:
        """Loads the scene."""
        return load_scene(service, output, self.scene, self.parameters, self.lenient, self.root)

    def path(self, scene: fogbank.Scene) -> list[dict[str, Any]]:
        """The cameras; UsageError for a contradiction."""
        return path_cameras(
            scene,
            cameras=self.cameras,
            frames=self.frames,
            orbit=self.orbit,
            target=self.target,
            degrees=self.degrees,
        )

    def frame_path(self, number: int) -> Path:
        """Of one picture."""
        return Path(self.pattern % number)


def sweep_options(command: Callable[..., Result]) -> Callable[..., Result]:
    """Adds what sweeps have in common. The command gets it as `choice`, but for the options of the frames."""
    return grouped(
        command,
        "choice",
        SweepChoice,
        (
            click.argument("scene", type=click.Path(path_type=Path)),
            click.option(
                *("-o", "--output", "pattern"),
                type=FramePatternType(),
                required=True,
                help=".exr or .png of each frame.",
            ),
            camera_path_options,
            click.option(
                "--fill",
                type=click.Choice(["first", "ahead", "none"]),
                help="Make the records of all frames first (the default with a cache), those of later frames while "
                "earlier ones are rendered, or none but as each frame's own render makes them.",
            ),
            click.option("--resume", is_flag=True, help="Skip frames whose file is there."),
            click.option("--in-flight", type=click.IntRange(1), default=2, show_default=True, help="Frames at once."),
            frame_options,
            loading_options,
            exposure_option,
        ),
    )


class FillEvents(Protocol):
    """`SceneCache.fill_events`, or the farm's."""

    def __call__(
        self, cameras: Sequence[Mapping[str, Any]], /, **options: Unpack[RenderOptions]
    ) -> Iterator[fogbank.FillProgress]:
        """Makes the records that the cameras need."""


def render_sweep(
    choice: SweepChoice,
    scene: fogbank.Scene,
    service: fogbank.Service,
    output: Output,
    options: RenderOptions,
    *,
    start: Callable[[RenderOptions], fogbank.Job],
    fill_events: FillEvents,
    only: tuple[int, int] | None = None,
) -> None:
    """Makes the records and renders the frames, and tells what came of it.

    Args:
        choice: the options of the command.
        scene: loaded.
        service: that it is loaded on.
        output: where events and results go.
        options: what the frames share.
        start: starts a job with these options.
        fill_events: makes records.
        only: the first and the last frame to render; all when None.
    """
    path = choice.path(scene)
    first, last = (0, len(path) - 1) if only is None else only
    if last >= len(path):
        raise click.UsageError(f"--only: there are {len(path)} frames, the last one is {len(path) - 1}")
    todo = [
        Frame(number, choice.frame_path(number), camera)
        for number, camera in enumerate(path)
        if first <= number <= last and not (choice.resume and choice.frame_path(number).is_file())
    ]
    choice.frame_path(0).parent.mkdir(parents=True, exist_ok=True)
    totals = Totals(frames=last - first + 1, skipped=last - first + 1 - len(todo))
    wanted = _fill_wanted(choice, scene, service, options) if todo else "none"
    cache = scene.cache.name

    def make_records(cameras: Sequence[Mapping[str, Any]]) -> fogbank.FillProgress:
        chosen = fill_options(options)
        if wanted == "ahead" and options.get("records") is not None:
            # So many in all, as when all are made first.
            chosen["records"] = max(0, (options["records"] or 0) - totals.records_new)
        report = fill(cache, fill_events(cameras, **chosen), output)
        totals.fill(report)
        return report

    frames: Iterator[tuple[Frame, RenderOptions]]
    if wanted == "ahead":
        frames = _filled_ahead(path, todo, options, make_records)
    else:
        if wanted == "first":
            report = make_records(path)
            tell_filled(cache, report, output)
            options = _reading(options, report.epoch)
        frames = ((frame, options) for frame in todo)
    render_frames(start, frames, output, totals, in_flight=choice.in_flight, exposure=choice.exposure)
    output.event("done", **vars(totals))
    output.text(totals.summary())


def _fill_wanted(choice: SweepChoice, scene: fogbank.Scene, service: fogbank.Service, options: RenderOptions) -> Fill:
    integrator = options.get("integrator") or scene.defaults.integrator
    if choice.fill is not None:
        return choice.fill
    cached = integrator in service.capabilities.cached_integrators
    return "first" if cached and options.get("records") != 0 else "none"


def _filled_ahead(
    path: Sequence[Mapping[str, Any]],
    todo: Sequence[Frame],
    options: RenderOptions,
    make_records: Callable[[Sequence[Mapping[str, Any]]], fogbank.FillProgress],
) -> Iterator[tuple[Frame, RenderOptions]]:
    """The frames in their order, each with the epoch of its records. Those of skipped frames are made as well: what a
    frame reads must not depend on what was interrupted."""
    waiting = deque(todo)
    for number, camera in enumerate(path):
        if not waiting:
            return
        report = make_records([camera])
        if waiting[0].number == number:
            yield waiting.popleft(), _reading(options, report.epoch)


def _reading(options: RenderOptions, epoch: int) -> RenderOptions:
    """Those of frames that make no records of their own: how many there may be was the fill's affair."""
    chosen = RenderOptions(**{**options, "epoch": epoch})
    chosen.pop("records", None)
    return chosen


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
    fills: int = 0
    records_reused: int = 0
    records_new: int = 0
    epoch: int = 0
    fill_seconds: float = 0.0
    render_seconds: float = 0.0
    render_cpu_seconds: float = 0.0
    rays: int = 0

    def fill(self, report: fogbank.FillProgress) -> None:
        """Counts a fill."""
        if self.fills == 0:
            self.records_reused = report.records_reused
        self.fills += 1
        self.records_new += report.records_new
        self.epoch = report.epoch
        self.fill_seconds += report.elapsed_seconds
        self.rays += report.rays

    def frame(self, statistics: fogbank.RenderStatistics) -> None:
        """Counts a frame."""
        if self.rendered == 0 and self.fills == 0:
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
    frames: Iterator[tuple[Frame, RenderOptions]],
    output: Output,
    totals: Totals,
    *,
    in_flight: int,
    exposure: float,
) -> None:
    """Renders the frames in their order, a few jobs ahead; cancels what is left when one of them fails.

    Args:
        start: starts a job with these options.
        frames: the frames with their options; the next one is asked for when there is room for it.
        output: where events and results go.
        totals: counts the frames.
        in_flight: jobs at once.
        exposure: stops, for .png files.
    """
    running: deque[tuple[Frame, fogbank.Job]] = deque()
    left = True
    try:
        while left or running:
            while left and len(running) < in_flight:
                following = next(frames, None)
                if following is None:
                    left = False
                    break
                frame, options = following
                job = start(RenderOptions(**{**options, "camera": frame.camera}))
                output.event("job", frame=frame.number, job=job.name, settings=job.settings)
                running.append((frame, job))
            if not running:
                return
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
