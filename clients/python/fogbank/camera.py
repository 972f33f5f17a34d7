"""Replacing a scene's camera."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from fogbank._generated.v1 import render_pb2
from fogbank.errors import InvalidArgumentError

CameraLike: TypeAlias = "Mapping[str, Any] | npt.ArrayLike | str | os.PathLike[str]"
"""What describes a camera.

- A mapping, or the path of a JSON file with one, holding either `origin`, `target` and optionally `up` (3 numbers
  each, scene units; `up` is [0, 1, 0] when left out) or `to_world` (4x4, or 16 numbers row by row); and optionally
  `fov` (horizontal, degrees), `aperture_radius` and `focus_distance` (scene units, thin-lens cameras only).
- A 4x4 matrix: camera to world.

The camera looks along its +z axis and +y is up, as in Mitsuba 3. What is left out stays as in the scene file.
"""

_OPTICS = {"fov": "fov_degrees", "aperture_radius": "aperture_radius", "focus_distance": "focus_distance"}
_PLACEMENT = frozenset({"origin", "target", "up", "to_world"})


def camera_message(camera: CameraLike) -> render_pb2.CameraOverride:
    """The wire form of a camera; InvalidArgumentError names what is wrong with it."""
    if isinstance(camera, str | os.PathLike):
        camera = _read_json(Path(camera))
    if not isinstance(camera, Mapping):
        camera = {"to_world": camera}
    unknown = sorted(set(camera) - _PLACEMENT - set(_OPTICS))
    if unknown:
        known = ", ".join(sorted(_PLACEMENT | set(_OPTICS)))
        raise InvalidArgumentError(f"camera: unknown entry {unknown[0]!r}; known are {known}")
    message = render_pb2.CameraOverride()
    for key, field in _OPTICS.items():
        if key in camera:
            setattr(message, field, float(_numbers(camera, key, 1)[0]))
    if "to_world" in camera:
        clash = sorted(_PLACEMENT & set(camera) - {"to_world"})
        if clash:
            raise InvalidArgumentError(f"camera: give either to_world or {clash[0]}, not both")
        message.to_world.extend(_numbers(camera, "to_world", 16).tolist())
    elif _PLACEMENT & set(camera):
        for key in ("origin", "target"):
            if key not in camera:
                raise InvalidArgumentError(f"camera: {key} is missing; origin and target go together")
        up = _numbers(camera, "up", 3) if "up" in camera else np.array([0.0, 1.0, 0.0])
        matrix = look_at(_numbers(camera, "origin", 3), _numbers(camera, "target", 3), up)
        message.to_world.extend(matrix.ravel().tolist())
    return message


def camera_options(message: render_pb2.CameraOverride) -> dict[str, Any]:
    """The mapping that `camera_message` turns into this message."""
    given = {field.name: value for field, value in message.ListFields()}
    camera: dict[str, Any] = {name: given[field] for name, field in _OPTICS.items() if field in given}
    if "to_world" in given:
        camera["to_world"] = list(message.to_world)
    return camera


def look_at(
    origin: npt.NDArray[np.float64], target: npt.NDArray[np.float64], up: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Camera-to-world matrix (4, 4) of a camera at `origin` that looks at `target`, all of shape (3,), scene units."""
    direction = target - origin
    distance = float(np.linalg.norm(direction))
    if distance == 0.0:
        raise InvalidArgumentError("camera: origin and target are the same point")
    direction = direction / distance
    left = np.cross(up, direction)
    sine_times_up = float(np.linalg.norm(left))
    # Below this the rounding of the cross product, and no longer the user, decides what is up.
    if sine_times_up <= 1e-9 * float(np.linalg.norm(up)):
        raise InvalidArgumentError("camera: up is parallel to the direction from origin to target")
    left = left / sine_times_up
    matrix = np.eye(4)
    matrix[:3, 0] = left
    matrix[:3, 1] = np.cross(direction, left)
    matrix[:3, 2] = direction
    matrix[:3, 3] = origin
    return matrix


def _read_json(path: Path) -> Mapping[str, Any] | list[Any]:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidArgumentError(f"camera: cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InvalidArgumentError(f"camera: {path} is not JSON: {error}") from None
    if not isinstance(value, dict | list):
        raise InvalidArgumentError(f"camera: {path} holds neither an object nor a matrix")
    return value


def _numbers(camera: Mapping[str, Any], key: str, count: int) -> npt.NDArray[np.float64]:
    try:
        values = np.asarray(camera[key], dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise InvalidArgumentError(f"camera: {key} is not made of numbers") from None
    if values.size != count:
        raise InvalidArgumentError(f"camera: {key} needs {count} number(s) and has {values.size}")
    if not np.all(np.isfinite(values)):
        raise InvalidArgumentError(f"camera: {key} is not finite")
    return values
