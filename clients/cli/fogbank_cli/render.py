"""`fogbank render`: from a scene file to an image."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click
import fogbank
from fogbank import RenderOptions, UploadProgress, Window

from fogbank_cli.image_output import exposure_option, follow_and_save, watch_tev_option
from fogbank_cli.output import Output, quantity
from fogbank_cli.parameter_types import ImagePathType, SizeType, WindowType
from fogbank_cli.session import Session, json_option, loading_options, pass_session

# With a viewer attached; else the server's own, sparse cadence is right.
_LIVE_UPDATE_SECONDS = 0.25


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "paths", type=ImagePathType(), multiple=True, required=True, help=".exr or .png; may be repeated."
)
@click.option("--integrator", help="How radiance is computed, e.g. volpath.")
@click.option("--spp", type=click.IntRange(1), help="Samples per pixel.")
@click.option("--time", "time_budget", type=float, metavar="SECONDS", help="End after this time, with fewer samples.")
@click.option("--seed", type=click.IntRange(0, 2**64 - 1), help="Of the random numbers; 0 by default.")
@click.option("--size", type=SizeType(), help="Of the film, in pixels.")
@click.option("--crop", type=WindowType(), help="The part of the film to render.")
@click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit.")
@click.option("--rr-depth", type=int, help="Path length from which Russian roulette ends paths.")
@click.option("--camera", type=click.Path(path_type=Path), help="JSON: origin, target, up or to_world; fov.")
@click.option("--half", "pixel_type", flag_value="half", help="16-bit pixels (the default).")
@click.option("--float", "pixel_type", flag_value="float", help="32-bit pixels.")
@click.option("--variance", is_flag=True, help="Add variance channels to the .exr.")
@click.option("--threads", type=click.IntRange(1), help="Most threads at work on this job.")
@click.option("--tile-size", type=int, help="Side of a tile in pixels.")
@click.option("--tile-order", type=click.Choice(["scan", "spiral"]), help="In which order tiles are rendered.")
@click.option("--region", type=WindowType(), help="Tiles that touch this window come first.")
@loading_options
@exposure_option
@watch_tev_option
@json_option
@pass_session
def render(
    session: Session,
    /,
    scene: Path,
    paths: tuple[Path, ...],
    integrator: str | None,
    spp: int | None,
    time_budget: float | None,
    seed: int | None,
    size: tuple[int | None, int | None] | None,
    crop: Window | None,
    max_depth: int | None,
    rr_depth: int | None,
    camera: Path | None,
    pixel_type: Literal["half", "float"] | None,
    variance: bool,
    threads: int | None,
    tile_size: int | None,
    tile_order: Literal["scan", "spiral"] | None,
    region: Window | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    exposure: float,
    watch_tev: tuple[str, int] | None,
) -> None:
    """Render SCENE, a Mitsuba 3 XML file, and write the image.

    Whatever is not given is taken from the scene file. Ctrl-C cancels the render; a second one leaves without waiting
    for the server's answer.
    """
    options: RenderOptions = {
        "integrator": integrator,
        "spp": spp,
        "time_budget": time_budget,
        "seed": seed,
        "size": size,
        "crop": crop,
        "max_depth": max_depth,
        "rr_depth": rr_depth,
        "camera": camera,
        "pixel_type": pixel_type,
        "variance": variance,
        "threads": threads,
        "tile_size": tile_size,
        "tile_order": tile_order,
        "region": region,
        "update_interval": None if watch_tev is None else _LIVE_UPDATE_SECONDS,
    }
    output = session.output
    with session.connect() as service:
        output.event("server", address=service.address, embedded=service.embedded, version=service.capabilities.version)
        loaded = service.load(
            scene,
            parameters=dict(parameters),
            lenient=lenient,
            root=root,
            on_progress=UploadReport(output),
        )
        report_scene(loaded, output)
        job = loaded.render(**options)
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
