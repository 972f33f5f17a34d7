"""Options that name several cameras: a file of keyframes, or an orbit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import click
import fogbank

from fogbank_cli.parameter_types import PointType

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def camera_path_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--cameras`, `--frames`, `--orbit`, `--target`, `--degrees`."""
    for option in (
        click.option("--degrees", type=float, help="Of the whole orbit; 360 by default."),
        click.option(
            "--target", type=PointType(), help="What the orbit turns around; the middle of the view if not given."
        ),
        click.option(
            "--orbit", type=click.IntRange(1), metavar="N", help="N frames around the scene, from its camera on."
        ),
        click.option(
            "--frames",
            type=click.IntRange(1),
            metavar="N",
            help="Interpolate N frames; the keyframes alone if not given.",
        ),
        click.option(
            "--cameras", type=click.Path(path_type=Path), help="JSON list of keyframes: origin, target, up, fov."
        ),
    ):
        command = option(command)
    return command


def path_cameras(
    scene: fogbank.Scene,
    *,
    cameras: Path | None,
    frames: int | None,
    orbit: int | None,
    target: tuple[float, float, float] | None,
    degrees: float | None,
) -> list[dict[str, Any]]:
    """The cameras that the options of `camera_path_options` describe; UsageError for a contradiction."""
    if (cameras is None) == (orbit is None):
        raise click.UsageError("give either --cameras or --orbit")
    if cameras is not None:
        if target is not None or degrees is not None:
            raise click.UsageError("--target and --degrees belong to --orbit")
        keyframes = fogbank.read_keyframes(cameras)
        return fogbank.interpolate(keyframes, frames if frames is not None else len(keyframes))
    if frames is not None:
        raise click.UsageError("--frames belongs to --cameras; --orbit has its own number of frames")
    assert orbit is not None
    return fogbank.orbit(
        scene.defaults.camera_to_world,
        scene.bounds.center,
        orbit,
        target=target,
        degrees=360.0 if degrees is None else degrees,
    )
