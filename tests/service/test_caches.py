"""Radiance caches: what survives, what is shared, what is the same to the bit, what is refused."""

from __future__ import annotations

import io
import random
import time
from collections.abc import Callable
from pathlib import Path

import grpc
import numpy as np
import OpenEXR
import pytest
from fogbank._generated.v1 import cache_pb2 as cache
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene_messages
from fogbank._generated.v1 import server_pb2
from fogbank.camera import camera_message

from tests.service.harness import Pixels, Server, error_info, fog_scene

# Coarse and small: these tests are about where records go, not how good they are.
COARSE = 1.0


def cached_scene(extra: str = "") -> bytes:
    """The room with isotropic fog, whose light is cached."""
    text = fog_scene(width=24, height=18, samples=2, extra=extra).decode()
    isotropic = text.replace('<phase type="hg"><float name="g" value="0.7"/></phase>', '<phase type="isotropic"/>')
    assert isotropic != text
    return isotropic.encode()


def settings(**fields: object) -> render.RenderSettings:
    """Of a small picture with the cache."""
    message = render.RenderSettings(integrator="radiance-cache", pixel_type=render.PIXEL_TYPE_FLOAT)
    message.samples_per_pixel = 2
    message.error = COARSE
    for name, value in fields.items():
        setattr(message, name, value)
    return message


A = camera_message({"origin": [0, 0, 4], "target": [0, 0, 0], "fov": 50})
B = camera_message({"origin": [3, 1, 3], "target": [0, 0, 0], "fov": 50})


def seen_from(camera: render.CameraOverride, **fields: object) -> render.RenderSettings:
    """As `settings`, from another camera."""
    message = settings(**fields)
    message.camera.CopyFrom(camera)
    return message


def picture(server: Server, name: str, message: render.RenderSettings) -> tuple[render.Job, Pixels]:
    """A finished job and its pixels."""
    job = server.finish(server.create_job(name, message).name)
    return job, server.image(job.name)


@pytest.fixture
def second_server(tmp_path: Path) -> Server:
    """Another machine."""
    return Server(tmp_path / "second", "--threads", "1")


def test_a_job_reports_records_and_errors(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    job, _ = picture(own_server, scene.name, settings())
    result = job.result
    assert result.cache == scene.cache
    assert result.records_reused == 0
    assert result.records_new > 0
    assert len(result.history) >= 1
    last = result.history[-1]
    assert last.records == result.records_new
    assert last.estimated_error <= COARSE
    assert last.estimated_error == pytest.approx((last.noise**2 + last.bias**2) ** 0.5)
    assert not last.HasField("true_error")
    described = own_server.caches.GetCache(cache.GetCacheRequest(name=scene.cache)).cache
    assert described.records == result.records_new
    assert sum(component.records for component in described.components) == described.records
    assert described.disk_bytes > 0
    assert described.memory_bytes > 0


def test_a_second_camera_reuses_the_records_of_the_first(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    first, _ = picture(own_server, scene.name, seen_from(A))
    again, _ = picture(own_server, scene.name, seen_from(A))
    assert again.result.records_reused == first.result.records_new
    assert again.result.records_new < first.result.records_new
    second, _ = picture(own_server, scene.name, seen_from(B))
    assert second.result.records_reused == again.result.records_reused + again.result.records_new
    assert second.result.records_new < first.result.records_new


def test_the_cache_survives_a_restart_with_the_same_bits(own_server: Server, second_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    own_server.fill(scene.name, settings(), [A])
    before = own_server.export(scene.cache)
    own_server.stop()
    restarted = Server(own_server.data, "--threads", "1")
    try:
        assert restarted.export(scene.cache) == before
        # The picture is that of a server which has had these records all the time.
        second_server.import_cache(before)
        second_server.create_scene(cached_scene())
        job, pixels = picture(restarted, scene.name, seen_from(A))
        assert job.result.records_reused > 0
        _, expected = picture(second_server, scene.name, seen_from(A))
        np.testing.assert_array_equal(pixels, expected)
    finally:
        restarted.stop()
        second_server.stop()


def test_filling_for_two_cameras_is_the_same_at_once_apart_and_over_a_restart(
    own_server: Server, second_server: Server
) -> None:
    scene = own_server.create_scene(cached_scene())
    second_server.create_scene(cached_scene())
    own_server.fill(scene.name, settings(), [A])
    own_server.stop()
    restarted = Server(own_server.data, "--threads", "2")
    try:
        apart = restarted.fill(scene.name, settings(), [B])
        together = second_server.fill(scene.name, settings(), [A, B])
        assert together.records_new == apart.records_reused + apart.records_new
        assert restarted.export(scene.cache) == second_server.export(scene.cache)
    finally:
        restarted.stop()
        second_server.stop()


def test_an_exported_cache_gives_the_same_picture_elsewhere(server: Server, second_server: Server) -> None:
    try:
        scene = server.create_scene(cached_scene())
        server.fill(scene.name, settings(), [A])
        exported = server.export(scene.cache)
        # The records are there before the scene is.
        imported = second_server.import_cache(exported)
        assert imported.records_new == imported.cache.records > 0
        assert second_server.import_cache(exported, scene.cache).records_new == 0
        assert second_server.create_scene(cached_scene()).cache == scene.cache
        _, here = picture(server, scene.name, seen_from(A))
        job, there = picture(second_server, scene.name, seen_from(A))
        assert job.result.records_reused > 0
        np.testing.assert_array_equal(here, there)
    finally:
        second_server.stop()


def test_caches_that_were_filled_apart_merge_in_either_order(own_server: Server, second_server: Server) -> None:
    try:
        scene = own_server.create_scene(cached_scene())
        second_server.create_scene(cached_scene())
        own_server.fill(scene.name, settings(), [A])
        second_server.fill(scene.name, settings(), [B])
        a, b = own_server.export(scene.cache), second_server.export(scene.cache)
        own_server.import_cache(b)
        second_server.import_cache(a)
        union = own_server.merge(a, b)
        assert union == own_server.merge(b, a) == own_server.merge(b, a, b)
        assert own_server.export(scene.cache) == second_server.export(scene.cache) == union
        _, here = picture(own_server, scene.name, settings())
        _, there = picture(second_server, scene.name, settings())
        np.testing.assert_array_equal(here, there)
    finally:
        second_server.stop()


def test_a_kept_epoch_stays_as_it_was(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    epoch = own_server.fill(scene.name, settings(), [A]).epoch
    _, before = picture(own_server, scene.name, seen_from(A, epoch=epoch))
    own_server.fill(scene.name, settings(), [B])
    job, after = picture(own_server, scene.name, seen_from(A, epoch=epoch))
    assert job.result.records_new == 0
    np.testing.assert_array_equal(before, after)
    # A camera that the records were not made for is rendered all the same, and makes none.
    job, _ = picture(own_server, scene.name, seen_from(B, epoch=epoch))
    assert job.result.records_new == 0
    with pytest.raises(grpc.RpcError) as refused:
        own_server.create_job(scene.name, settings(epoch=epoch + 1000))
    assert error_info(refused.value).reason == "EPOCH_GONE"


def test_caches_are_listed_verified_and_removed(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    other = own_server.create_scene(cached_scene(SMALL_BLOCK))
    for name in (scene.name, other.name):
        own_server.fill(name, settings(), [A])
    names = sorted([scene.cache, other.cache])
    page = own_server.caches.ListCaches(cache.ListCachesRequest(page_size=1))
    assert [item.name for item in page.caches] == names[:1]
    rest = own_server.caches.ListCaches(cache.ListCachesRequest(page_token=page.next_page_token))
    assert [item.name for item in rest.caches] == names[1:]
    report = own_server.caches.VerifyCache(cache.VerifyCacheRequest(name=scene.cache))
    assert report.damaged_segments == 0
    assert report.records == own_server.caches.GetCache(cache.GetCacheRequest(name=scene.cache)).cache.records
    collected = own_server.caches.CollectCacheGarbage(cache.CollectCacheGarbageRequest(budget_bytes=0))
    assert sorted(collected.removed) == names
    own_server.fill(scene.name, settings(), [A])
    own_server.caches.DeleteCache(cache.DeleteCacheRequest(name=scene.cache))
    with pytest.raises(grpc.RpcError) as missing:
        own_server.caches.DeleteCache(cache.DeleteCacheRequest(name=scene.cache))
    assert error_info(missing.value).reason == "CACHE_NOT_FOUND"
    # What was removed is made anew.
    assert own_server.fill(scene.name, settings(), [A]).records_reused == 0


SMALL_BLOCK = """<shape type="cube"><transform name="to_world"><scale value="0.1"/><translate y="1"/></transform>
<bsdf type="diffuse"/></shape>"""


def test_a_damaged_cache_costs_time_and_nothing_else(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    made = own_server.fill(scene.name, settings(), [A]).records_new
    own_server.stop()
    segments = [path for path in (own_server.data / "caches").rglob("segments/*") if path.is_file()]
    assert segments
    for path in segments:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    restarted = Server(own_server.data, "--threads", "2")
    try:
        report = restarted.fill(scene.name, settings(), [A])
        assert report.records_reused < made
        assert report.records_reused + report.records_new == made
    finally:
        restarted.stop()


def test_a_view_holds_every_record_and_a_plan(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    made = own_server.fill(scene.name, settings(), [A]).records_new
    responses = list(
        own_server.caches.ViewCache(cache.ViewCacheRequest(scene=scene.name, settings=settings(), side=80))
    )
    kinds = [str(response.WhichOneof("part")) for response in responses]
    assert kinds[0] == "plan"
    assert sorted(kinds[1:], reverse=True) == kinds[1:]
    plan = responses[0].plan
    assert max(plan.width, plan.height) == 80
    assert (plan.right_axis, plan.down_axis, plan.up_axis) == (0, 2, 1)
    rows = [response.rows for response in responses if response.HasField("rows")]
    assert sum(len(part.depth) for part in rows) == plan.width * plan.height
    solid = np.frombuffer(b"".join(part.solid for part in rows), np.uint8).reshape(plan.height, plan.width)
    # The block, a unit cube turned by 30 degrees, is cut through if the records' median height is in it.
    if abs(plan.cut) < 0.5:
        assert solid.sum() * plan.pixel_size**2 == pytest.approx(1.0, rel=0.1)
    records = [response.records for response in responses if response.HasField("records")]
    assert sum(len(part.positions) for part in records) == 3 * made
    semi_axes = np.concatenate([np.array(part.semi_axes).reshape(-1, 3, 3) for part in records])
    lengths = np.linalg.norm(semi_axes, axis=-1)
    assert np.all(np.diff(lengths, axis=1) <= 1e-6 * lengths[:, :1])
    assert np.all(lengths[:, 1] > 0)


def test_a_reference_brings_the_true_error(server: Server) -> None:
    scene = server.create_scene(cached_scene())
    volpath = bad(integrator="volpath", pixel_type=render.PIXEL_TYPE_FLOAT)
    exr = server.download(server.finish(server.create_job(scene.name, volpath).name).name)
    volpath.reference_sha256 = server.upload(exr)
    same = server.finish(server.create_job(scene.name, volpath).name)
    # The picture against itself.
    assert same.result.history[-1].true_error.relative_mse < 1e-10
    volpath.seed = 7
    errors = server.finish(server.create_job(scene.name, volpath).name).result.history[-1].true_error
    assert errors.percentile_99 >= errors.median > 0
    assert errors.relative_mse > 0


def test_aovs_are_channels_of_the_picture(server: Server) -> None:
    scene = server.create_scene(cached_scene())
    message = settings(variance=True)
    message.aovs.extend([render.AOV_RADIUS, render.AOV_RECORD_DENSITY, render.AOV_BIAS])
    job = server.finish(server.create_job(scene.name, message).name)
    with OpenEXR.File(io.BytesIO(server.download(job.name))) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    names = {"cache.radius", "cache.record-density", "cache.bias"}
    assert names <= set(channels)
    assert "cache.rejected" not in channels
    for name in names:
        assert np.all(np.isfinite(channels[name]))
        assert channels[name].max() > 0


def test_threads_of_a_cancelled_fill_are_free_soon(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    call = own_server.caches.FillCache(
        cache.FillCacheRequest(scene=scene.name, settings=settings(error=1e-3, width=256, height=192), cameras=[A])
    )
    assert not next(iter(call)).done
    time.sleep(0.5)
    call.cancel()
    wait_until_idle(own_server)
    spent = own_server.cpu_seconds()
    time.sleep(0.5)
    assert own_server.cpu_seconds() - spent < 0.1
    # What was made is not lost: a coarser fill starts from it.
    assert own_server.fill(scene.name, settings(), [A]).records_reused > 0


def wait_until_idle(server: Server) -> None:
    """Until no thread renders."""
    end = time.monotonic() + 30
    while server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).busy_threads > 0:
        assert time.monotonic() < end, "the threads of a cancelled fill are still busy"
        time.sleep(0.01)


def bad(**fields: object) -> render.RenderSettings:
    """Settings without the small ones' error and samples."""
    return render.RenderSettings(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("message", "field", "text"),
    [
        (bad(integrator="volpath", records=5), "records", 'the integrator "volpath" has no cache'),
        (bad(integrator="volpath", spheres=True), "spheres", 'the integrator "volpath" has no cache'),
        (bad(integrator="volpath", minimum_radius=0.1), "minimum_radius", 'the integrator "volpath" has no cache'),
        (
            bad(integrator="radiance-cache", minimum_radius=-0.5),
            "minimum_radius",
            "-0.500000 is negative or not finite",
        ),
        (bad(integrator="volpath", epoch=1), "epoch", 'the integrator "volpath" has no cache'),
        (bad(integrator="volpath", aovs=[render.AOV_BIAS]), "aovs", 'the integrator "volpath" has no cache'),
        (
            bad(integrator="volpath", single_scattering=render.SINGLE_SCATTERING_CACHED),
            "single_scattering",
            'the integrator "volpath" has one way for all light',
        ),
        (
            bad(integrator="radiance-cache-unaware", single_scattering=render.SINGLE_SCATTERING_DIRECT),
            "single_scattering",
            'the integrator "radiance-cache-unaware" has one way for all light',
        ),
        (bad(integrator="radiance-cache", single_scattering=99), "single_scattering", "is not a SingleScattering"),
        (bad(integrator="radiance-cache", error=-1.0), "error", "must be positive"),
        (bad(integrator="radiance-cache", error=float("nan")), "error", "must be positive"),
        (bad(integrator="radiance-cache", records=-1), "records", "-1 is not in 0 .. 4294967296"),
        (bad(integrator="radiance-cache", epoch=1, records=5), "records", "a job of a given epoch makes no records"),
        (bad(integrator="radiance-cache", aovs=[99]), "aovs", "99 is not an Aov"),
    ],
)
def test_wrong_settings_are_named(
    server: Server, scene: scene_messages.Scene, message: render.RenderSettings, field: str, text: str
) -> None:
    with pytest.raises(grpc.RpcError) as refused:
        server.create_job(scene.name, message)
    info = error_info(refused.value)
    assert (info.reason, info.metadata["field"]) == ("INVALID_SETTINGS", f"settings.{field}")
    assert refused.value.details() == f"settings.{field}: {text}"


def first(call: grpc.Call) -> None:
    """Reads a stream until it ends."""
    for _ in call:  # type: ignore[attr-defined]
        pass


@pytest.mark.parametrize(
    ("request_of", "reason", "text"),
    [
        (
            lambda server, scene: server.caches.GetCache(cache.GetCacheRequest(name="caches/1")),
            "INVALID_NAME",
            '"caches/1" is not a name of the form caches/{64 hexadecimal digits}',
        ),
        (
            lambda server, scene: server.caches.GetCache(cache.GetCacheRequest(name="caches/" + "0" * 64)),
            "CACHE_NOT_FOUND",
            "there is no caches/" + "0" * 64,
        ),
        (
            lambda server, scene: first(server.caches.ExportCache(cache.ExportCacheRequest(name="caches/" + "0" * 64))),
            "CACHE_NOT_FOUND",
            "there is no caches/" + "0" * 64,
        ),
        (
            lambda server, scene: server.caches.ImportCache(cache.ImportCacheRequest(sha256="0" * 64)),
            "BLOBS_MISSING",
            "the cache file is not uploaded",
        ),
        (
            lambda server, scene: first(server.caches.MergeCaches(cache.MergeCachesRequest())),
            "INVALID_MERGE",
            "0 files; a merge takes 2 to 64",
        ),
        (
            lambda server, scene: server.caches.CollectCacheGarbage(cache.CollectCacheGarbageRequest(budget_bytes=-1)),
            "INVALID_BUDGET",
            "budget_bytes must not be negative",
        ),
        (
            lambda server, scene: server.fill(scene.name, bad(integrator="volpath")),
            "INVALID_SETTINGS",
            'settings.integrator: "volpath" has no cache to fill',
        ),
        (
            lambda server, scene: server.fill(scene.name, seen_from(A)),
            "INVALID_SETTINGS",
            "settings.camera: a fill has a list of cameras of its own",
        ),
        (
            lambda server, scene: server.fill(scene.name, settings(), [A, render.CameraOverride(to_world=[1.0])]),
            "INVALID_SETTINGS",
            "cameras[1]: settings.camera.to_world: needs 16 numbers, row by row",
        ),
        (
            lambda server, scene: first(
                server.caches.ViewCache(cache.ViewCacheRequest(scene=scene.name, settings=settings(), side=5000))
            ),
            "INVALID_VIEW",
            "side: must be 1 to 4096",
        ),
        (
            lambda server, scene: first(
                server.caches.ViewCache(cache.ViewCacheRequest(scene=scene.name, settings=settings(), up_axis=3))
            ),
            "INVALID_VIEW",
            "up_axis: must be 0, 1 or 2",
        ),
    ],
)
def test_wrong_requests_are_refused(
    server: Server,
    scene: scene_messages.Scene,
    request_of: Callable[[Server, scene_messages.Scene], object],
    reason: str,
    text: str,
) -> None:
    with pytest.raises(grpc.RpcError) as refused:
        request_of(server, scene)
    assert error_info(refused.value).reason == reason
    assert refused.value.details() == text


def test_hostile_files_are_one_clear_error_each(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    own_server.fill(scene.name, settings(), [A])
    exported = own_server.export(scene.cache)
    dice = random.Random(20261122)
    memory = own_server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).memory_bytes
    for _ in range(100):
        hostile = bytearray(exported)
        # Lengths, counts and names lie in the first 100 bytes.
        start = dice.randrange(dice.choice((100, len(hostile))))
        hostile[start : start + dice.choice((1, 4, 8, 100))] = dice.randbytes(dice.choice((1, 4, 8, 100)))
        if bytes(hostile) == exported:
            continue
        digest = own_server.upload(bytes(hostile[: dice.choice((len(hostile), dice.randrange(1, len(hostile))))]))
        with pytest.raises(grpc.RpcError) as refused:
            own_server.caches.ImportCache(cache.ImportCacheRequest(sha256=digest))
        assert error_info(refused.value).reason == "INVALID_CACHE_FILE"
        with pytest.raises(grpc.RpcError) as refused:
            list(own_server.caches.MergeCaches(cache.MergeCachesRequest(sha256s=[digest, digest])))
        assert error_info(refused.value).reason == "INVALID_CACHE_FILE"
    assert own_server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).memory_bytes < memory + (64 << 20)
    assert own_server.export(scene.cache) == exported


def test_a_cache_that_memory_has_no_room_for_is_refused(own_server: Server, tmp_path: Path) -> None:
    scene = own_server.create_scene(cached_scene())
    own_server.fill(scene.name, settings(), [A])
    small = Server(tmp_path / "small", "--memory", "0.00001")
    with pytest.raises(grpc.RpcError) as refused:
        small.import_cache(own_server.export(scene.cache))
    assert refused.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert error_info(refused.value).reason == "CACHE_TOO_LARGE"
    assert small.stop() == 0


def test_files_that_are_no_caches_change_nothing(own_server: Server) -> None:
    scene = own_server.create_scene(cached_scene())
    own_server.fill(scene.name, settings(), [A])
    exported = own_server.export(scene.cache)
    damaged = bytearray(exported)
    damaged[len(damaged) // 2] ^= 1
    for data in (b"nothing of the kind", bytes(damaged), exported[:-1]):
        with pytest.raises(grpc.RpcError) as refused:
            own_server.import_cache(data)
        assert error_info(refused.value).reason == "INVALID_CACHE_FILE"
    with pytest.raises(grpc.RpcError) as refused:
        own_server.import_cache(exported, "caches/" + "0" * 64)
    assert error_info(refused.value).reason == "CACHE_OF_ANOTHER_SCENE"
    other = own_server.create_scene(cached_scene(SMALL_BLOCK))
    own_server.fill(other.name, settings(), [A])
    with pytest.raises(grpc.RpcError) as refused:
        own_server.merge(exported, own_server.export(other.cache))
    assert error_info(refused.value).reason == "CACHE_OF_ANOTHER_SCENE"
    assert own_server.export(scene.cache) == exported
