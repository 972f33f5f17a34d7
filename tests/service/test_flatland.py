"""The two-dimensional model over the wire: what a call promises, what it refuses, and that it can be stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import flatland_pb2 as messages
from fogbank._generated.v1 import server_pb2
from fogbank.flatland import FlatlandScene, read_scene

from tests.service.harness import PATIENCE_SECONDS, Server, error_info

SCENES = Path(__file__).resolve().parents[2] / "scenes" / "flatland"
POINTS = [0.63, 0.31, 0.27, 0.31, 0.83, 0.72]


def box() -> FlatlandScene:
    """The scene of the table in method.md section 16."""
    return read_scene(SCENES / "box.json")


def request(
    coordinates: Iterable[float] = POINTS,
    settings: messages.FlatlandSettings | None = None,
    scene: FlatlandScene | None = None,
) -> messages.ProbeFlatlandRequest:
    """A request with small defaults."""
    return messages.ProbeFlatlandRequest(
        scene=scene or box(),
        settings=settings or messages.FlatlandSettings(samples=64, order=messages.FLATLAND_ORDER_SINGLE),
        coordinates=coordinates,
    )


def test_every_point_is_answered_with_all_settings_filled_in(server: Server) -> None:
    response = server.flatland.ProbeFlatland(request(settings=messages.FlatlandSettings()))
    assert (len(response.radiance), len(response.gradient), len(response.hessian)) == (3, 6, 9)
    assert (len(response.stratified_mean), len(response.rays)) == (3, 3)
    assert np.isfinite([*response.radiance, *response.gradient, *response.hessian]).all()
    settings = response.settings
    assert {field.name for field, _ in settings.ListFields()} == set(settings.DESCRIPTOR.fields_by_name) - {"seed"}
    assert settings.method == messages.FLATLAND_METHOD_AWARE
    assert settings.order == messages.FLATLAND_ORDER_BOTH
    again = server.flatland.ProbeFlatland(request(settings=settings))
    assert again == response


def test_answers_do_not_depend_on_the_other_points(server: Server) -> None:
    points = np.random.default_rng(1).uniform(0.02, 0.5, (300, 2))
    whole = server.flatland.ProbeFlatland(request(points.ravel().tolist()))
    order = np.random.default_rng(2).permutation(len(points))
    shuffled = server.flatland.ProbeFlatland(request(points[order].ravel().tolist()))
    np.testing.assert_array_equal(np.array(whole.radiance)[order], shuffled.radiance)
    np.testing.assert_array_equal(np.array(whole.hessian).reshape(-1, 3)[order].ravel(), shuffled.hessian)


def test_no_points_are_no_error(server: Server) -> None:
    assert not server.flatland.ProbeFlatland(request([])).radiance


def test_seeds_give_other_numbers(server: Server) -> None:
    def gradient(seed: int) -> list[float]:
        settings = messages.FlatlandSettings(samples=64, order=messages.FLATLAND_ORDER_SINGLE, bisections=0, seed=seed)
        return list(server.flatland.ProbeFlatland(request(settings=settings)).gradient)

    assert gradient(1) == gradient(1)
    assert gradient(1) != gradient(2)


def test_scene_files_are_read_and_answered(server: Server) -> None:
    paths = sorted(SCENES.glob("*.json"))
    assert len(paths) >= 3
    for path in paths:
        settings = messages.FlatlandSettings(samples=64)
        response = server.flatland.ProbeFlatland(request(settings=settings, scene=read_scene(path)))
        assert min(response.radiance) > 0, path


def _bad_scene(damage: Callable[[FlatlandScene], None]) -> messages.ProbeFlatlandRequest:
    scene = box()
    damage(scene)
    return request(scene=scene)


def _no_segment(scene: FlatlandScene) -> None:
    scene.segments.add()


def _negative_radiance(scene: FlatlandScene) -> None:
    scene.segments[0].radiance = -1


def _crowd(scene: FlatlandScene) -> None:
    scene.segments.extend([scene.segments[0]] * 40)


@pytest.mark.parametrize(
    ("bad", "reason", "field"),
    [
        (_bad_scene(_no_segment), "INVALID_SCENE", "scene.segments[2]"),
        (_bad_scene(_negative_radiance), "INVALID_SCENE", "scene.segments[0].radiance"),
        (_bad_scene(_crowd), "INVALID_SCENE", "scene.segments"),
        (request(settings=messages.FlatlandSettings(samples=3)), "INVALID_SETTINGS", "settings.samples"),
        (request(settings=messages.FlatlandSettings(march_step=0)), "INVALID_SETTINGS", "settings.march_step"),
        (request(settings=messages.FlatlandSettings(march_step=1e-9)), "INVALID_SETTINGS", "settings.march_step"),
        (request(settings=messages.FlatlandSettings(method=9)), "INVALID_SETTINGS", "settings.method"),  # type: ignore[arg-type]
        (request(settings=messages.FlatlandSettings(order=9)), "INVALID_SETTINGS", "settings.order"),  # type: ignore[arg-type]
        (request([0.5, 0.5, 0.4, 0.55]), "INVALID_POINT", "points[1]"),
        (request([0.5, 1.5]), "INVALID_POINT", "points[0]"),
        (request([0.5, float("nan")]), "INVALID_POINT", "points[0]"),
        (request([0.5, 0.5, 0.4]), "INVALID_POINT", "points[1]"),
    ],
)
def test_refusals_name_the_field(server: Server, bad: messages.ProbeFlatlandRequest, reason: str, field: str) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        server.flatland.ProbeFlatland(bad)
    assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    info = error_info(caught.value)
    assert info.reason == reason
    assert info.metadata["field"] == field
    assert (caught.value.details() or "").startswith(field + ": ")


def test_too_many_points_name_the_limit(server: Server) -> None:
    count = int(server.limit("max_flatland_points")) + 1
    with pytest.raises(grpc.RpcError) as caught:
        server.flatland.ProbeFlatland(request([0.5] * (2 * count)))
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert error_info(caught.value).reason == "TOO_MANY_POINTS"


def test_exact_multiple_scattering_of_many_segments_is_refused(server: Server) -> None:
    scene = box()
    for i in range(3):
        segment = scene.segments.add()
        segment.start.x, segment.start.y = 0.6 + 0.1 * i, 0.2
        segment.end.x, segment.end.y = 0.63 + 0.1 * i, 0.33 + 0.02 * i
    with pytest.raises(grpc.RpcError) as caught:
        server.flatland.ProbeFlatland(
            request(settings=messages.FlatlandSettings(method=messages.FLATLAND_METHOD_EXACT), scene=scene)
        )
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert error_info(caught.value).reason == "TOO_MANY_CREASES"


def fill_request(**changes: object) -> messages.FillFlatlandCacheRequest:
    """A small fill; `changes` are of its cache settings."""
    x, y = np.meshgrid((np.arange(16) + 0.5003) / 16, (np.arange(16) + 0.5003) / 16)
    return messages.FillFlatlandCacheRequest(
        scene=box(),
        settings=messages.FlatlandSettings(samples=64, order=messages.FLATLAND_ORDER_SINGLE),
        cache=messages.FlatlandCacheSettings(**{"threshold": 1e-4, **changes}),  # type: ignore[arg-type]
        coordinates=np.stack([x.ravel(), y.ravel()], axis=-1).ravel().tolist(),
    )


def test_a_fill_answers_every_point_with_all_settings_filled_in(server: Server) -> None:
    response = server.flatland.FillFlatlandCache(fill_request())
    assert len(response.radiance) == 256
    count = len(response.record_coordinates) // 2
    assert 64 <= count <= 256
    assert len(response.record_axis) == len(response.record_semi_axes) == 2 * count
    assert np.isfinite([*response.radiance, *response.record_axis, *response.record_semi_axes]).all()
    for settings in (response.settings, response.cache):
        assert {field.name for field, _ in settings.ListFields()} == set(settings.DESCRIPTOR.fields_by_name) - {"seed"}
    again = fill_request()
    again.cache.CopyFrom(response.cache)
    again.settings.CopyFrom(response.settings)
    assert server.flatland.FillFlatlandCache(again) == response


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"threshold": 0}, "cache.threshold"),
        ({"threshold": float("nan")}, "cache.threshold"),
        ({"metric": 9}, "cache.metric"),
        ({"shape": 9}, "cache.shape"),
        ({"maximum_anisotropy": 0.5}, "cache.maximum_anisotropy"),
        ({"maximum_radius": 0}, "cache.maximum_radius"),
        ({"minimum_radius": -1}, "cache.minimum_radius"),
        ({"pilot": 0}, "cache.pilot"),
        ({"pilot": 257}, "cache.pilot"),
    ],
)
def test_refusals_of_a_fill_name_the_field(server: Server, changes: dict[str, object], field: str) -> None:
    with pytest.raises(grpc.RpcError) as caught:
        server.flatland.FillFlatlandCache(fill_request(**changes))
    assert caught.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    info = error_info(caught.value)
    assert info.reason == "INVALID_SETTINGS"
    assert info.metadata["field"] == field


def test_fills_end_at_their_limits(server: Server) -> None:
    crowd = fill_request()
    crowd.coordinates.extend([0.5] * (2 * int(server.limit("max_flatland_cache_points"))))
    nothing = fill_request()
    del nothing.coordinates[:]
    for bad, code, reason in (
        (crowd, grpc.StatusCode.RESOURCE_EXHAUSTED, "TOO_MANY_POINTS"),
        (nothing, grpc.StatusCode.INVALID_ARGUMENT, "INVALID_POINT"),
    ):
        with pytest.raises(grpc.RpcError) as caught:
            server.flatland.FillFlatlandCache(bad)
        assert caught.value.code() == code
        assert error_info(caught.value).reason == reason


def test_a_cancelled_fill_frees_its_thread(own_server: Server) -> None:
    long = fill_request()
    long.settings.samples = 65536
    call = own_server.flatland.FillFlatlandCache.future(long)
    wait_for_busy_threads(own_server, 1)
    call.cancel()
    wait_for_busy_threads(own_server, 0)


def wait_for_busy_threads(server: Server, count: int) -> None:
    """Returns when so many threads compute."""
    end = time.monotonic() + PATIENCE_SECONDS
    while server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).busy_threads != count:
        assert time.monotonic() < end
        time.sleep(0.02)


def long_request() -> messages.ProbeFlatlandRequest:
    """Minutes of work."""
    points = np.random.default_rng(3).uniform(0.02, 0.5, (4096, 2))
    settings = messages.FlatlandSettings(samples=1024, order=messages.FLATLAND_ORDER_MULTIPLE)
    return request(points.ravel().tolist(), settings)


def test_a_cancelled_call_frees_the_threads(own_server: Server) -> None:
    call = own_server.flatland.ProbeFlatland.future(long_request())
    wait_for_busy_threads(own_server, 2)
    call.cancel()
    wait_for_busy_threads(own_server, 0)


def test_the_server_ends_in_the_middle_of_a_call(own_server: Server) -> None:
    call = own_server.flatland.ProbeFlatland.future(long_request())
    wait_for_busy_threads(own_server, 2)
    own_server.process.terminate()
    assert own_server.process.wait(PATIENCE_SECONDS) == 0
    assert call.code() in (grpc.StatusCode.CANCELLED, grpc.StatusCode.UNAVAILABLE)
