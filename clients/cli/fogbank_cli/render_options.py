"""Options shared by the commands that render or fill a cache; their names are those of `fogbank.RenderOptions`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import click
import fogbank
from fogbank import RenderOptions

from fogbank_cli.parameter_types import AovsType, Bands, BandsType, SizeType, WindowType

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_INTEGRATOR_OPTIONS = (
    click.option(
        "--integrator",
        help="How radiance is computed, e.g. radiance-cache, photon-beams or volpath; by default as suits the scene.",
    ),
)

_TARGET_OPTIONS = (
    click.option(
        "--error", type=float, metavar="RELATIVE", help="End when the estimated error is no greater, e.g. 0.02."
    ),
    click.option("--time", "time_budget", type=float, metavar="SECONDS", help="End after this time."),
)

_RECORD_OPTIONS = (
    click.option(
        "--records",
        type=click.IntRange(0),
        help="Make the cache finer until so many records are made; 0: only read those that are there.",
    ),
    click.option(
        "--single-scattering",
        type=click.Choice(["auto", "direct", "cached"]),
        help="Light scattered once: sampled or from records; light by light by predicted cost (auto), as a rule.",
    ),
    click.option("--spheres", is_flag=True, default=None, help="Extents of records: spheres instead of ellipsoids."),
    click.option(
        "--minimum-radius",
        type=click.FloatRange(min=0.0),
        metavar="LENGTH",
        help="Least radius of a record's extent, scene units, whatever its error: fewer records, blurred shadows.",
    ),
    click.option("--size", type=SizeType(), help="Of the film, in pixels."),
)

_CROP_OPTIONS = (click.option("--crop", type=WindowType(), help="The part of the film to render."),)

_TRANSPORT_OPTIONS = (
    click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit."),
    click.option("--seed", type=click.IntRange(0, 2**64 - 1), help="Of the random numbers; 0 by default."),
)

_CACHE_OPTIONS = _INTEGRATOR_OPTIONS + _TARGET_OPTIONS + _RECORD_OPTIONS + _CROP_OPTIONS + _TRANSPORT_OPTIONS

_PIXEL_OPTIONS = (
    click.option("--spp", type=click.IntRange(1), help="Samples per pixel; the most with --error or --time."),
    click.option("--rr-depth", type=int, help="Path length from which Russian roulette ends paths."),
    click.option("--half", "pixel_type", flag_value="half", help="16-bit pixels (the default)."),
    click.option("--float", "pixel_type", flag_value="float", help="32-bit pixels."),
    click.option("--variance", is_flag=True, default=None, help="Add variance channels to the .exr."),
    click.option("--aov", "aovs", type=AovsType(), help="Add channels to the .exr: what the cache says of each pixel."),
    click.option("--threads", type=click.IntRange(1), help="Most threads at work on one job."),
    click.option("--tile-size", type=int, help="Side of a tile in pixels."),
    click.option("--tile-order", type=click.Choice(["scan", "spiral"]), help="In which order tiles are rendered."),
)

_PICTURE_OPTIONS = (
    click.option("--camera", type=click.Path(path_type=Path), help="JSON: origin, target, up or to_world; fov."),
    click.option("--region", type=WindowType(), help="Tiles that touch this window come first."),
    click.option(
        "--reference",
        type=click.Path(path_type=Path),
        help=".exr of the same window of the same film; reports the true error of each pass.",
    ),
    click.option("--epoch", type=click.IntRange(0), help="Read the cache as of an epoch that a fill has named."),
)


def part_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what makes a part of a picture elsewhere: `--bands`, `--cache`."""
    return _with(
        command,
        (
            click.option(
                "--bands", type=BandsType(), help="Render bands A to B of COUNT, to be joined by `fogbank join`."
            ),
            click.option(
                "--cache",
                "cache_file",
                type=click.Path(path_type=Path, dir_okay=False, exists=True),
                help="Add the records of an exported file first.",
            ),
        ),
    )


def take_part(scene: fogbank.Scene, bands: Bands | None, options: RenderOptions) -> None:
    """Makes the window of the bands the crop window of the options."""
    if bands is None:
        return
    width, height = options.get("size") or scene.defaults.size
    if options.get("crop") is not None or width is None or height is None:
        raise click.UsageError("--bands divides the whole film: leave out --crop, and give both sides of --size")
    options["crop"] = bands.window(width, height)


def cache_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what decides which records are made."""
    return _with(command, _CACHE_OPTIONS)


def frame_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what all frames of a sweep may share."""
    return _with(command, _CACHE_OPTIONS + _PIXEL_OPTIONS)


def fixed_picture_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what parts of a picture may share that are made apart: nothing that is decided while they are made."""
    return _with(command, _INTEGRATOR_OPTIONS + _RECORD_OPTIONS + _TRANSPORT_OPTIONS + _PIXEL_OPTIONS)


def picture_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds everything that a single picture takes."""
    return _with(command, _CACHE_OPTIONS + _PIXEL_OPTIONS + _PICTURE_OPTIONS)


def _with(
    command: Callable[Parameters, Result],
    options: tuple[Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]], ...],
) -> Callable[Parameters, Result]:
    for option in reversed(options):
        command = option(command)
    return command
