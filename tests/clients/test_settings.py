"""Render options and cameras, as they go over the wire."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fogbank import CameraLike, InvalidArgumentError, RenderOptions, Window
from fogbank._generated.v1 import render_pb2
from fogbank.camera import camera_message, look_at
from fogbank.settings import options_from_message, settings_message


def test_nothing_given_leaves_everything_to_the_server() -> None:
    assert settings_message({}) == render_pb2.RenderSettings()
    assert settings_message({"spp": None, "camera": None, "variance": None}) == render_pb2.RenderSettings()


def test_every_option_reaches_its_field_and_comes_back() -> None:
    options: RenderOptions = {
        "integrator": "volpath",
        "spp": 64,
        "time_budget": 1.5,
        "seed": 2**64 - 1,
        "size": (640, 360),
        "crop": Window(1, 2, 30, 40),
        "max_depth": -1,
        "rr_depth": 5,
        "tile_size": 16,
        "tile_order": "scan",
        "region": Window(3, 4, 5, 6),
        "pixel_type": "float",
        "camera": {"to_world": list(np.eye(4).ravel()), "fov": 40.0},
        "error": 0.02,
        "records": 5000,
        "single_scattering": "cached",
        "spheres": True,
        "minimum_radius": 0.25,
        "epoch": 7,
        "aovs": ["radius", "bias"],
        "reference": "sha256:" + 64 * "a",
        "variance": True,
        "threads": 2,
        "update_interval": 0.5,
    }
    assert set(options) == set(RenderOptions.__annotations__)
    message = settings_message(options)
    assert {field.name for field, _ in message.ListFields()} == set(render_pb2.RenderSettings.DESCRIPTOR.fields_by_name)
    assert options_from_message(message) == options


def test_one_side_of_the_size_may_be_left_to_the_aspect_ratio() -> None:
    assert settings_message({"size": (640, None)}) == render_pb2.RenderSettings(width=640)
    assert settings_message({"size": (None, 360)}) == render_pb2.RenderSettings(height=360)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spp", "many"),
        ("single_scattering", "none"),
        ("aovs", ["depth"]),
        ("reference", "never-uploaded.exr"),
        ("spp", 1.5),
        ("seed", -1),
        ("seed", 2**64),
        ("size", 640),
        ("size", (640, 360, 3)),
        ("size", (2**40, 1)),
        ("crop", (0, 0, 10)),
        ("crop", "0,0,10,10"),
        ("region", (0, 0, 2**40, 1)),
        ("tile_order", "random"),
        ("pixel_type", "double"),
    ],
)
def test_a_value_of_the_wrong_kind_is_refused_by_name(name: str, value: object) -> None:
    options: Any = {name: value}
    with pytest.raises(InvalidArgumentError, match=f"^{name}: "):
        settings_message(options)


def test_an_unknown_option_is_a_type_error() -> None:
    options: Any = {"samples": 4}
    with pytest.raises(TypeError, match="samples"):
        settings_message(options)


def test_look_at_has_the_axes_of_mitsuba() -> None:
    matrix = look_at(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, -5.0]), np.array([0.0, 1.0, 0.0]))
    # Camera +z is the direction of view, +y is up, and so +x points left.
    np.testing.assert_array_equal(matrix[:3, 2], [0, 0, -1])
    np.testing.assert_array_equal(matrix[:3, 1], [0, 1, 0])
    np.testing.assert_array_equal(matrix[:3, 0], [-1, 0, 0])
    np.testing.assert_array_equal(matrix[:3, 3], [1, 2, 3])
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])


def test_look_at_is_a_rotation_for_any_up() -> None:
    matrix = look_at(np.array([4.0, -2.0, 1.0]), np.array([-1.0, 3.0, 2.0]), np.array([0.1, 0.2, 5.0]))
    rotation = matrix[:3, :3]
    # Rounding only: products of a few numbers of magnitude one.
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_a_camera_can_be_given_in_every_way(tmp_path: Path) -> None:
    placed = {"origin": [0, 0, 0], "target": [0, 0, 1], "fov": 30}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(placed))
    expected = render_pb2.CameraOverride(to_world=np.eye(4).ravel().tolist(), fov_degrees=30.0)
    assert camera_message(placed) == expected
    assert camera_message(path) == expected
    assert camera_message(str(path)) == expected
    assert camera_message({"to_world": np.eye(4), "fov": 30.0}) == expected
    assert camera_message(np.eye(4)) == render_pb2.CameraOverride(to_world=np.eye(4).ravel().tolist())
    assert camera_message({"focus_distance": 2.0}) == render_pb2.CameraOverride(focus_distance=2.0)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ({"origin": [0, 0, 0]}, "target is missing"),
        ({"target": [0, 0, 0]}, "origin is missing"),
        ({"origin": [0, 0, 0], "target": [0, 0, 0]}, "same point"),
        ({"origin": [0, 0, 0], "target": [0, 2, 0]}, "parallel"),
        ({"origin": [0, 0, 0], "target": [0, 0, 1], "up": [0, 0, 0]}, "parallel"),
        ({"origin": [0, 0], "target": [0, 0, 1]}, "origin needs 3"),
        ({"origin": [0, 0, float("nan")], "target": [0, 0, 1]}, "not finite"),
        ({"origin": "here", "target": [0, 0, 1]}, "not made of numbers"),
        ({"to_world": np.eye(4), "origin": [0, 0, 0]}, "not both"),
        ({"matrix": np.eye(4)}, "unknown entry 'matrix'"),
        (np.eye(3), "needs 16"),
        ("missing.json", "cannot read"),
    ],
)
def test_a_wrong_camera_is_refused(camera: CameraLike, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        camera_message(camera)


def test_a_camera_file_that_is_not_json_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text("{origin")
    with pytest.raises(InvalidArgumentError, match="is not JSON"):
        camera_message(path)
    path.write_text("3")
    with pytest.raises(InvalidArgumentError, match="neither an object nor a matrix"):
        camera_message(path)
