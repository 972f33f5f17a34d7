"""Options of a render, and their wire form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from fogbank._generated.v1 import render_pb2, scene_pb2
from fogbank.camera import CameraLike, camera_message, camera_options
from fogbank.errors import InvalidArgumentError
from fogbank.window import Window


class RenderOptions(TypedDict, total=False):
    """Everything that `Scene.render` takes; what is left out (or None) is the scene's own value or the default."""

    integrator: str | None
    """One of `Service.capabilities().integrators`."""

    spp: int | None
    """Samples per pixel, >= 1."""

    time_budget: float | None
    """Seconds of rendering, > 0; ends with the last complete pass, even with fewer samples."""

    seed: int | None
    """Seed of the random numbers, 0 to 2**64 - 1; 0 by default."""

    size: tuple[int | None, int | None] | None
    """Film width and height in pixels; one of them may be None to follow the scene's aspect ratio."""

    crop: Window | Sequence[int] | None
    """The part of the film to render: x, y, width, height in pixels."""

    max_depth: int | None
    """Greatest path length in edges, -1 for no limit."""

    rr_depth: int | None
    """Path length from which Russian roulette ends paths, >= 1."""

    tile_size: int | None
    """Side of a tile in pixels."""

    tile_order: Literal["scan", "spiral"] | None
    """In which order a pass visits its tiles; never changes the image."""

    region: Window | Sequence[int] | None
    """Tiles that touch this window come first: x, y, width, height in pixels."""

    pixel_type: Literal["half", "float"] | None
    """Number format of the pixels in tiles and in the final file."""

    camera: CameraLike | None
    """Replaces the scene's camera, see `fogbank.CameraLike`."""

    variance: bool | None
    """Adds the estimated variance of each pixel's value to the image."""

    threads: int | None
    """Most threads that work on this job at once, >= 1."""

    update_interval: float | None
    """Least seconds between two updates of one tile; small for a live view, large for a batch job."""


_FIELDS = {
    "integrator": "integrator",
    "spp": "samples_per_pixel",
    "time_budget": "time_budget_seconds",
    "seed": "seed",
    "max_depth": "max_depth",
    "rr_depth": "rr_depth",
    "tile_size": "tile_size",
    "variance": "variance",
    "threads": "max_threads",
    "update_interval": "update_interval_seconds",
}
_WINDOWS = ("crop", "region")
_TILE_ORDERS = {
    "scan": render_pb2.TILE_ORDER_SCAN,
    "spiral": render_pb2.TILE_ORDER_SPIRAL,
}
_PIXEL_TYPES = {
    "half": render_pb2.PIXEL_TYPE_HALF,
    "float": render_pb2.PIXEL_TYPE_FLOAT,
}


def settings_message(options: RenderOptions) -> render_pb2.RenderSettings:
    """The wire form of the options.

    Raises TypeError for an unknown option and InvalidArgumentError, naming the option, for a value that does not
    fit its type. Ranges are the server's business.
    """
    unknown = sorted(set(options) - set(RenderOptions.__annotations__))
    if unknown:
        raise TypeError(f"render() has no option {unknown[0]!r}")
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    message = render_pb2.RenderSettings()
    for name, field in _FIELDS.items():
        if name in given:
            try:
                setattr(message, field, given[name])
            except (TypeError, ValueError) as error:
                raise InvalidArgumentError(f"{name}: {error}", metadata={"field": f"settings.{field}"}) from None
    for name in _WINDOWS:
        if name in given:
            getattr(message, name).CopyFrom(_window_message(name, given[name]))
    if "size" in given:
        _set_size(message, given["size"])
    if "tile_order" in given:
        message.tile_order = _choice("tile_order", given["tile_order"], _TILE_ORDERS)
    if "pixel_type" in given:
        message.pixel_type = _choice("pixel_type", given["pixel_type"], _PIXEL_TYPES)
    if "camera" in given:
        message.camera.CopyFrom(camera_message(given["camera"]))
    return message


def options_from_message(message: render_pb2.RenderSettings) -> RenderOptions:
    """The options that a job's effective settings amount to, the camera as a mapping if it was replaced."""
    given = {field.name: value for field, value in message.ListFields()}
    options = RenderOptions(seed=message.seed, variance=message.variance)
    for name, field in _FIELDS.items():
        if field in given:
            options[name] = given[field]  # type: ignore[literal-required]
    for name in _WINDOWS:
        if name in given:
            options[name] = Window.from_message(given[name])  # type: ignore[literal-required]
    for name, choices in (("tile_order", _TILE_ORDERS), ("pixel_type", _PIXEL_TYPES)):
        for word, number in choices.items():
            if given.get(name) == number:
                options[name] = word  # type: ignore[literal-required]
    if "width" in given and "height" in given:
        options["size"] = (message.width, message.height)
    if "camera" in given:
        options["camera"] = camera_options(message.camera)
    return options


def _choice(name: str, value: object, choices: dict[str, Any]) -> Any:  # noqa: ANN401 - an enum of any kind
    if value not in choices:
        raise InvalidArgumentError(
            f"{name}: {value!r} is none of {', '.join(choices)}", metadata={"field": f"settings.{name}"}
        )
    return choices[str(value)]


def _window_message(name: str, value: Sequence[int]) -> scene_pb2.Window:
    try:
        x, y, width, height = value
        return Window(x, y, width, height).to_message()
    except (TypeError, ValueError):
        raise InvalidArgumentError(
            f"{name}: {value!r} is not x, y, width, height in whole pixels", metadata={"field": f"settings.{name}"}
        ) from None


def _set_size(message: render_pb2.RenderSettings, size: Sequence[int | None]) -> None:
    try:
        width, height = size
        if width is not None:
            message.width = width
        if height is not None:
            message.height = height
    except (TypeError, ValueError):
        raise InvalidArgumentError(
            f"size: {size!r} is not (width, height) in whole pixels", metadata={"field": "settings.width"}
        ) from None
