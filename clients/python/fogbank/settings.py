"""Options of a render, and their wire form."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, TypedDict

from fogbank._generated.v1 import render_pb2, scene_pb2
from fogbank.camera import CameraLike, camera_message, camera_options
from fogbank.errors import InvalidArgumentError
from fogbank.image import Image
from fogbank.window import Window

SingleScattering: TypeAlias = Literal["auto", "direct", "cached"]
AovName: TypeAlias = Literal["radius", "record-density", "rejected", "variance", "bias"]
Reference: TypeAlias = "str | os.PathLike[str] | Image"

REFERENCE_PREFIX = "sha256:"


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

    error: float | None
    """Ends with the first complete pass whose estimated relative error is no greater, 1e-6 to 10."""

    records: int | None
    """Makes the cache finer until so many records are made; 0: only reads those that are there."""

    single_scattering: SingleScattering | None
    """How single scattering is computed, with an integrator that has a cache; "auto" by predicted cost."""

    spheres: bool | None
    """Gives records the extents of spheres instead of ellipsoids."""

    minimum_radius: float | None
    """Least radius of a record's extent in scene units, >= 0, whatever its error: fewer records, blurred shadows."""

    epoch: int | None
    """Reads the cache as it was at this epoch, which `SceneCache.fill` has named, and makes no record."""

    aovs: Sequence[AovName] | None
    """Additional channels of the image: what the cache says about each pixel, see `fogbank.Image.aovs`."""

    reference: Reference | None
    """An image of the same window of the same film, to report the true error of each pass against: the path of an EXR
    file, a `fogbank.Image`, or "sha256:..." of a file that the server holds."""

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
    "error": "error",
    "records": "records",
    "spheres": "spheres",
    "minimum_radius": "minimum_radius",
    "epoch": "epoch",
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
_SINGLE_SCATTERING = {
    "auto": render_pb2.SINGLE_SCATTERING_AUTOMATIC,
    "direct": render_pb2.SINGLE_SCATTERING_DIRECT,
    "cached": render_pb2.SINGLE_SCATTERING_CACHED,
}
_CHOICES: dict[str, dict[str, Any]] = {
    "tile_order": _TILE_ORDERS,
    "pixel_type": _PIXEL_TYPES,
    "single_scattering": _SINGLE_SCATTERING,
}
_AOVS = {
    "radius": render_pb2.AOV_RADIUS,
    "record-density": render_pb2.AOV_RECORD_DENSITY,
    "rejected": render_pb2.AOV_REJECTED,
    "variance": render_pb2.AOV_VARIANCE,
    "bias": render_pb2.AOV_BIAS,
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
    for name, choices in _CHOICES.items():
        if name in given:
            setattr(message, name, _choice(name, given[name], choices))
    if "aovs" in given:
        message.aovs.extend(_choice("aovs", aov, _AOVS) for aov in given["aovs"])
    if "reference" in given:
        message.reference_sha256 = _reference_sha256(given["reference"])
    if "camera" in given:
        message.camera.CopyFrom(camera_message(given["camera"]))
    return message


def options_from_message(message: render_pb2.RenderSettings) -> RenderOptions:
    """The options that a job's effective settings amount to, the camera as a mapping if it was replaced."""
    given = {field.name: value for field, value in message.ListFields()}
    options = RenderOptions(seed=message.seed, variance=message.variance, spheres=message.spheres)
    for name, field in _FIELDS.items():
        if field in given:
            options[name] = given[field]  # type: ignore[literal-required]
    for name in _WINDOWS:
        if name in given:
            options[name] = Window.from_message(given[name])  # type: ignore[literal-required]
    for name, choices in _CHOICES.items():
        for word, number in choices.items():
            if given.get(name) == number:
                options[name] = word  # type: ignore[literal-required]
    if message.aovs:
        names = {number: word for word, number in _AOVS.items()}
        options["aovs"] = [names[number] for number in message.aovs if number in names]  # type: ignore[misc]
    if message.reference_sha256:
        options["reference"] = REFERENCE_PREFIX + message.reference_sha256
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


def _reference_sha256(reference: Reference) -> str:
    """Of a reference that was uploaded before."""
    if isinstance(reference, str) and reference.startswith(REFERENCE_PREFIX):
        return reference.removeprefix(REFERENCE_PREFIX)
    raise InvalidArgumentError(
        f"reference: {reference!r} was not uploaded", metadata={"field": "settings.reference_sha256"}
    )


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
