"""`fogbank render`: from a scene file to an image."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import click
import fogbank
from fogbank import RenderOptions, UploadProgress
from fogbank.job_report import Priority

from fogbank_cli.image_output import exposure_option, follow_and_save, watch_tev_option
from fogbank_cli.output import Output, quantity
from fogbank_cli.parameter_types import Bands, ImagePathType
from fogbank_cli.render_options import part_options, picture_options, take_part
from fogbank_cli.session import Session, json_option, loading_options, openjd_option, pass_session

# With a viewer attached; else the server's own, sparse cadence is right.
_LIVE_UPDATE_SECONDS = 0.25


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "paths", type=ImagePathType(), multiple=True, required=True, help=".exr or .png; may be repeated."
)
@picture_options
@part_options
@click.option(
    "--priority",
    type=click.Choice(["interactive", "normal", "background"]),
    default="normal",
    show_default=True,
    help="Which of your jobs go first.",
)
@loading_options
@exposure_option
@watch_tev_option
@openjd_option
@json_option
@pass_session
def render(
    session: Session,
    /,
    scene: Path,
    paths: tuple[Path, ...],
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    exposure: float,
    watch_tev: tuple[str, int] | None,
    priority: Priority,
    bands: Bands | None,
    cache_file: Path | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Render SCENE, a Mitsuba 3 XML file, and write the image.

    Whatever is not given is taken from the scene file. An integrator with a cache reads the records of the scene that
    the server holds, and adds those that this camera lacks. Ctrl-C cancels the render; a second one leaves without
    waiting for the server's answer.
    """
    options["update_interval"] = None if watch_tev is None else _LIVE_UPDATE_SECONDS
    output = session.output
    with session.connect() as service:
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        take_part(loaded, bands, options)
        if cache_file is not None:
            loaded.cache.import_(cache_file)
        job = loaded.render(priority=priority, **options)
        output.event("job", job=job.name, settings=job.settings)
        follow_and_save(
            job,
            output,
            paths,
            tev_address=watch_tev,
            exposure=exposure,
            on_interrupt="cancel",
            load_seconds=loaded.load_seconds,
        )


def load_scene(
    service: fogbank.Service,
    output: Output,
    path: Path,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
) -> fogbank.Scene:
    """Pushes and loads a scene with the options of `loading_options`, and prints what happens."""
    output.event("server", address=service.address, embedded=service.embedded, version=service.capabilities.version)
    loaded = service.load(
        path, parameters=dict(parameters), lenient=lenient, root=root, on_progress=UploadReport(output)
    )
    report_scene(loaded, output)
    return loaded


class UploadReport:
    """Prints one event per uploaded file."""

    def __init__(self, output: Output) -> None:
        """Prints to `output`."""
        self._output = output

    def __call__(self, progress: UploadProgress) -> None:
        """Takes note of a chunk that was sent."""
        if progress.file_bytes_sent == progress.file_bytes:
            self._output.event("uploaded", path=progress.path, bytes=progress.file_bytes)


def report_scene(scene: fogbank.Scene, output: Output) -> None:
    """Prints what was loaded, and the loader's warnings."""
    output.event(
        "scene",
        scene=scene.name,
        main_path=scene.main_path,
        load_seconds=scene.load_seconds,
        statistics=scene.statistics,
        warnings=scene.warnings,
    )
    if not output.as_json:
        note_warnings(scene, output)
        if scene.load_seconds > 1.0:
            triangles = quantity(scene.statistics.triangles, "triangles")
            output.note(f"loaded {scene.main_path}, {triangles}, in {scene.load_seconds:.3g} s")


def note_warnings(scene: fogbank.Scene, output: Output) -> None:
    """Prints the loader's warnings on standard error."""
    for warning in scene.warnings:
        output.note(f"warning: {warning}")
