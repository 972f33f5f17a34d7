"""`fogbank openjd`: a job template for schedulers that speak Open Job Description."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Unpack

import click
from fogbank import RenderOptions
from fogbank.openjd import PictureTask, job_template, submission_parameters

from fogbank_cli.camera_paths import camera_path_options, path_cameras
from fogbank_cli.render import load_scene
from fogbank_cli.render_options import fixed_picture_options
from fogbank_cli.session import Session, json_option, loading_options, pass_session

_BANDS = 16


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "path", type=click.Path(path_type=Path, dir_okay=False), required=True, help=".yaml to write."
)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="For parts and pictures, on a disk that all machines share; by default beside the template, by its name.",
)
@click.option(
    "--bands", type=click.IntRange(1), default=_BANDS, show_default=True, help="Bands to divide a frame into."
)
@click.option("--bands-per-task", type=click.IntRange(1), default=4, show_default=True, help="Of these in one task.")
@camera_path_options
@fixed_picture_options
@loading_options
@json_option
@pass_session
def openjd(
    session: Session,
    /,
    scene: Path,
    path: Path,
    folder: Path | None,
    bands: int,
    bands_per_task: int,
    cameras: Path | None,
    frames: int | None,
    orbit: int | None,
    target: tuple[float, float, float] | None,
    degrees: float | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Write an Open Job Description template that renders SCENE, or frames of it along a camera path.

    `openjd run template.yaml` executes it here, and schedulers that read such templates on their machines. Its steps
    make the records of all frames, render bands of frames, and join them. Pictures have a fixed number of samples:
    parts that are made apart cannot decide together when they are good enough.
    """
    try:
        import yaml
    except ModuleNotFoundError:
        raise click.UsageError("yaml is not installed; it comes with pip install 'fogbank[farm]'") from None
    output = session.output
    with session.connect() as service:
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        defaults = loaded.defaults
        integrator = options.get("integrator") or defaults.integrator
        cached = integrator in service.capabilities.cached_integrators
        count = None
        if cameras is not None or orbit is not None:
            count = len(
                path_cameras(loaded, cameras=cameras, frames=frames, orbit=orbit, target=target, degrees=degrees)
            )
        elif frames is not None:
            raise click.UsageError("--frames belongs to --cameras")
        size = options.get("size") or defaults.size
        if None in size:
            raise click.UsageError("give both sides of --size")
        if bands_per_task > bands or bands > (size[1] or 0):
            raise click.UsageError(
                f"--bands: {bands_per_task} a task, {bands} in all, {size[1]} rows: none may be above the next"
            )
    chosen = RenderOptions(
        **{**options, "integrator": integrator, "size": size, "spp": options.get("spp") or defaults.spp}
    )
    loading = [part for name, value in parameters for part in ("-D", f"{name}={value}")]
    loading += ["--lenient"] if lenient else []
    task = PictureTask(
        scene=scene,
        folder=folder or path.with_suffix(""),
        loading=loading,
        record_arguments=_arguments(chosen, _RECORDS) if cached else None,
        picture_arguments=_arguments(chosen, _PICTURE),
        bands=bands,
        bands_per_task=bands_per_task,
        root=root,
        cameras=cameras,
        path_arguments=_path_arguments(frames, orbit, target, degrees),
        frames=count,
    )
    place = path.parent.absolute()
    template = job_template(f"fogbank {scene.stem}", task, place)
    path.write_text(yaml.safe_dump(template, sort_keys=False, width=120), encoding="utf-8")
    given = [f"{name}={value.absolute()}" for name, value in submission_parameters(task, place).items()]
    output.event("done", template=path, folder=task.folder, frames=count, bands=bands, parameters=given)
    output.text(f"{path}: {count or 1} frame{'s' if (count or 1) != 1 else ''} of {bands} bands, into {task.folder}")
    last = template["steps"][-1]["name"]
    command = ["openjd", "run", str(path), "--step", last, "--run-dependencies"]
    output.text(shlex.join([*command, *(part for pair in given for part in ("-p", pair))]))


_RECORDS = ("integrator", "records", "single_scattering", "spheres", "minimum_radius", "size", "max_depth")
_PICTURE = (
    *("integrator", "single_scattering", "spheres", "minimum_radius", "size", "max_depth", "seed", "spp", "rr_depth"),
    *("pixel_type", "variance", "aovs", "threads", "tile_size", "tile_order"),
)


def _arguments(options: RenderOptions, names: tuple[str, ...]) -> list[str]:
    """The options as they are written on a command line."""
    arguments: list[str] = []
    for name in names:
        value = options.get(name)
        option = {"pixel_type": f"--{value}", "aovs": "--aov"}.get(name, f"--{name.replace('_', '-')}")
        if value is None:
            continue
        if value is True or name == "pixel_type":
            arguments.append(option)
        elif name == "size":
            arguments += [option, "{}x{}".format(*value)]  # type: ignore[misc]
        elif name == "aovs":
            arguments += [option, ",".join(value)]  # type: ignore[arg-type]
        else:
            arguments += [option, str(value)]
    return arguments


def _path_arguments(
    frames: int | None, orbit: int | None, target: tuple[float, float, float] | None, degrees: float | None
) -> list[str]:
    arguments: list[str] = []
    for option, value in (("--frames", frames), ("--orbit", orbit), ("--degrees", degrees)):
        if value is not None:
            arguments += [option, str(value)]
    if target is not None:
        arguments += ["--target", ",".join(map(str, target))]
    return arguments
