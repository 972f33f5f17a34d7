"""Camera paths: keyframes that are interpolated, and orbits."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fogbank.camera import camera_message
from fogbank.errors import InvalidArgumentError

Vector = npt.NDArray[np.float64]

_REQUIRED = ("origin", "target")
_OPTICS = ("fov", "aperture_radius", "focus_distance")


def read_keyframes(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """The keyframes of a JSON file: a list of objects {"origin": [x, y, z], "target": [x, y, z]}, as of a camera.

    Each may have "up" ([0, 1, 0] when left out) and, all of them or none, "fov", "aperture_radius", "focus_distance".
    Raises InvalidArgumentError naming the keyframe and what is wrong with it.
    """
    path = Path(path)
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidArgumentError(f"cameras: cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InvalidArgumentError(f"cameras: {path} is not JSON: {error}") from None
    if not isinstance(value, list):
        raise InvalidArgumentError(f"cameras: {path} does not hold a list of keyframes")
    return checked_keyframes(value)


def checked_keyframes(keyframes: Sequence[Any]) -> list[dict[str, Any]]:
    """The keyframes, if they are as `read_keyframes` describes them."""
    if not keyframes:
        raise InvalidArgumentError("cameras: there is no keyframe")
    for number, keyframe in enumerate(keyframes):
        where = f"cameras: keyframe {number}"
        if not isinstance(keyframe, Mapping):
            raise InvalidArgumentError(f"{where} is not an object with origin and target")
        for key in _REQUIRED:
            if key not in keyframe:
                raise InvalidArgumentError(f"{where}: {key} is missing")
        if set(keyframe) & set(_OPTICS) != set(keyframes[0]) & set(_OPTICS):
            raise InvalidArgumentError(f"{where}: {', '.join(_OPTICS)} must be given in all keyframes or in none")
        try:
            camera_message(keyframe)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"{where}: {error.message.removeprefix('camera: ')}") from None
    return [dict(keyframe) for keyframe in keyframes]


def interpolate(keyframes: Sequence[Mapping[str, Any]], frames: int) -> list[dict[str, Any]]:
    """Cameras along a path, the first and the last keyframe included, evenly spaced in the keyframes' numbers.

    Origin and target follow uniform Catmull-Rom splines (E. Catmull, R. Rom, "A class of local interpolating splines",
    1974, tension 1/2), with the end points mirrored; `up` turns along the shortest arc (slerp); optics change linearly.

    Args:
        keyframes: as `read_keyframes` describes them.
        frames: >= 1; with 1 the first keyframe is all.
    """
    checked = checked_keyframes(keyframes)
    if frames < 1:
        raise InvalidArgumentError(f"frames: {frames} is not at least 1")
    last = len(checked) - 1
    times = np.linspace(0.0, last, frames) if frames > 1 else np.zeros(1)
    return [_camera_at(checked, float(time)) for time in times]


def orbit(
    camera_to_world: npt.ArrayLike,
    center: npt.ArrayLike,
    frames: int,
    *,
    target: npt.ArrayLike | None = None,
    degrees: float = 360.0,
) -> list[dict[str, Any]]:
    """Cameras that turn around a point, the given one first; with 360 degrees the frames go round once, evenly.

    Args:
        camera_to_world: (4, 4) or 16 numbers row by row; the camera that is turned.
        center: (3,) of the scene; without `target` the point of the line of sight nearest to it is turned around.
        frames: >= 1.
        target: (3,), what is turned around.
        degrees: of the whole turn, counter-clockwise seen from above; the last frame stays one step before its end.

    The axis is the world axis nearest to the camera's up.
    """
    if frames < 1:
        raise InvalidArgumentError(f"frames: {frames} is not at least 1")
    matrix = np.asarray(camera_to_world, dtype=np.float64).reshape(4, 4)
    origin, direction, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
    if target is None:
        ahead = float(np.dot(np.asarray(center, dtype=np.float64) - origin, direction))
        if ahead <= 0.0:
            raise InvalidArgumentError("orbit: the camera looks away from the scene; name a target")
        pivot = origin + ahead * direction
    else:
        pivot = np.asarray(target, dtype=np.float64)
    axis = np.zeros(3)
    dominant = int(np.argmax(np.abs(up)))
    axis[dominant] = np.sign(up[dominant])
    cameras = []
    for frame in range(frames):
        turn = np.eye(4)
        turn[:3, :3] = _rotation(axis, np.radians(degrees) * frame / frames)
        turn[:3, 3] = pivot - turn[:3, :3] @ pivot
        cameras.append({"to_world": (turn @ matrix).ravel().tolist()})
    return cameras


def _camera_at(keyframes: Sequence[Mapping[str, Any]], time: float) -> dict[str, Any]:
    index = min(int(time), max(len(keyframes) - 2, 0))
    share = time - index
    following = min(index + 1, len(keyframes) - 1)
    camera: dict[str, Any] = {
        key: _catmull_rom(
            [np.asarray(keyframe[key], dtype=np.float64) for keyframe in keyframes], index, share
        ).tolist()
        for key in _REQUIRED
    }
    ups = [np.asarray(keyframes[i].get("up", (0.0, 1.0, 0.0)), dtype=np.float64) for i in (index, following)]
    camera["up"] = _slerp(ups[0], ups[1], share).tolist()
    for key in _OPTICS:
        if key in keyframes[0]:
            camera[key] = (1.0 - share) * float(keyframes[index][key]) + share * float(keyframes[following][key])
    return camera


def _catmull_rom(points: Sequence[Vector], index: int, share: float) -> Vector:
    """Between points[index] and the next one; share 0 to 1."""
    if len(points) == 1:
        return points[0]
    p1, p2 = points[index], points[index + 1]
    p0 = points[index - 1] if index > 0 else 2.0 * p1 - p2
    p3 = points[index + 2] if index + 2 < len(points) else 2.0 * p2 - p1
    cubic = -p0 + 3.0 * p1 - 3.0 * p2 + p3
    square = 2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3
    value: Vector = 0.5 * (2.0 * p1 + share * ((p2 - p0) + share * (square + share * cubic)))
    return value


def _slerp(a: Vector, b: Vector, share: float) -> Vector:
    """Direction on the shortest arc from a to b, which need not have unit length."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))
    # Nearly the same direction: the arc is a straight line up to rounding. Opposite ones have no shortest arc.
    if angle < 1e-6:
        return a
    if np.pi - angle < 1e-6:
        raise InvalidArgumentError("cameras: up of one keyframe is opposite to that of the next one")
    direction: Vector = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    return direction


def _rotation(axis: Vector, angle: float) -> Vector:
    """Matrix (3, 3) that turns by `angle` radians around the unit vector `axis` (Rodrigues' formula)."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    matrix: Vector = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return matrix
