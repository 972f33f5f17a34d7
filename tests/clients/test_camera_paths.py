"""Camera paths: splines through keyframes, orbits, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fogbank import InvalidArgumentError, interpolate, orbit, read_keyframes
from fogbank.camera import look_at

KEYFRAMES: list[dict[str, Any]] = [
    {"origin": [0, 0, 0], "target": [0, 0, 9], "fov": 30},
    {"origin": [1, 2, 0], "target": [0, 1, 9], "fov": 40},
    {"origin": [4, 0, 1], "target": [2, 0, 9], "fov": 80},
]


def test_the_path_goes_through_every_keyframe() -> None:
    path = interpolate(KEYFRAMES, 9)
    for number, keyframe in enumerate(KEYFRAMES):
        for key in ("origin", "target", "fov"):
            np.testing.assert_allclose(path[4 * number][key], keyframe[key])


def test_a_path_along_a_line_is_even() -> None:
    line = [{"origin": [x, 0, 0], "target": [x, 0, 1]} for x in (0, 1, 2)]
    np.testing.assert_allclose([camera["origin"][0] for camera in interpolate(line, 5)], [0, 0.5, 1, 1.5, 2])


def test_the_spline_has_no_kink_at_keyframes() -> None:
    path = np.array([camera["origin"] for camera in interpolate(KEYFRAMES, 2001)])
    speed = np.diff(path, axis=0) * 1000
    # At the inner keyframe half the way between its neighbours, as Catmull and Rom have it, on both sides.
    np.testing.assert_allclose(speed[999:1001], np.tile((path[2000] - path[0]) / 2, (2, 1)), atol=0.02)


def test_up_turns_along_the_shortest_arc() -> None:
    turn = [
        {"origin": [0, 0, 0], "target": [0, 0, 1], "up": [0, 2, 0]},
        {"origin": [0, 0, 0], "target": [0, 0, 1], "up": [1, 0, 0]},
    ]
    ups = [camera["up"] for camera in interpolate(turn, 3)]
    np.testing.assert_allclose(ups, [[0, 1, 0], [0.5**0.5, 0.5**0.5, 0], [1, 0, 0]], atol=1e-12)


def test_one_frame_is_the_first_keyframe() -> None:
    (camera,) = interpolate(KEYFRAMES, 1)
    assert camera["origin"] == [0, 0, 0]
    assert interpolate(KEYFRAMES[:1], 3)[2]["origin"] == [0, 0, 0]


def test_an_orbit_keeps_its_distance_and_its_look() -> None:
    matrix = look_at(np.array([3.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    frames = [np.array(camera["to_world"]).reshape(4, 4) for camera in orbit(matrix, (0, 0, 0), 8)]
    np.testing.assert_allclose(frames[0], matrix, atol=1e-12)
    for frame in frames:
        np.testing.assert_allclose(np.linalg.norm(frame[:3, 3] - [0, 1, 0]), 3)
        np.testing.assert_allclose(frame[:3, 3] + 3 * frame[:3, 2], [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-12)
    # Counter-clockwise seen from above: from +x towards -z.
    assert frames[1][2, 3] < 0
    half = orbit(matrix, (0, 0, 0), 2, target=(3, 1, -3), degrees=180)
    np.testing.assert_allclose(np.array(half[1]["to_world"]).reshape(4, 4)[:3, 3], [6, 1, -3], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "is not JSON"),
        ("{}", "does not hold a list of keyframes"),
        ("[]", "there is no keyframe"),
        ("[1]", "keyframe 0 is not an object with origin and target"),
        ('[{"origin": [0, 0, 0]}]', "keyframe 0: target is missing"),
        ('[{"origin": [0, 0, 0], "target": [0, 0, 0]}]', "keyframe 0: origin and target are the same point"),
        ('[{"origin": [0, 0], "target": [0, 0, 1]}]', "keyframe 0: origin needs 3 number.s. and has 2"),
        (
            '[{"origin": [0, 0, 0], "target": [0, 0, 1], "fov": 3}, {"origin": [0, 0, 0], "target": [0, 0, 1]}]',
            "keyframe 1: fov, aperture_radius, focus_distance must be given in all keyframes or in none",
        ),
    ],
)
def test_a_wrong_file_says_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "path.json"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=message):
        read_keyframes(path)


def test_paths_that_cannot_be_interpolated() -> None:
    flip = [{"origin": [0, 0, 0], "target": [0, 0, 1], "up": [0, sign, 0]} for sign in (1, -1)]
    with pytest.raises(InvalidArgumentError, match="opposite"):
        interpolate(flip, 3)
    with pytest.raises(InvalidArgumentError, match="frames: 0"):
        interpolate(KEYFRAMES, 0)
    with pytest.raises(InvalidArgumentError, match="looks away"):
        orbit(np.eye(4), (0, 0, -3), 3)
