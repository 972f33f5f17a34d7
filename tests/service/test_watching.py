"""WatchJob: late, slow, many, gone and come back; always the same image."""

from __future__ import annotations

import random
import threading

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene_messages
from fogbank._generated.v1 import server_pb2

from tests.service.harness import Canvas, Server, decode, error_info, fog_scene


def lively(samples: int = 64, pixel_type: render.PixelType.ValueType = render.PIXEL_TYPE_HALF) -> render.RenderSettings:
    """Settings that give watchers as much to do as they can."""
    return render.RenderSettings(
        update_interval_seconds=0.05, tile_size=16, samples_per_pixel=samples, pixel_type=pixel_type
    )


@pytest.mark.parametrize("pixel_type", [render.PIXEL_TYPE_HALF, render.PIXEL_TYPE_FLOAT])
def test_the_stream_ends_with_the_final_image(
    server: Server, scene: scene_messages.Scene, pixel_type: render.PixelType.ValueType
) -> None:
    job = server.create_job(scene.name, lively(pixel_type=pixel_type))
    early = Canvas()
    assert server.watch(job.name, early).state == render.JOB_STATE_SUCCEEDED
    image = server.image(job.name)
    assert np.array_equal(early.pixels, image)
    late = Canvas()
    server.watch(job.name, late)
    assert np.array_equal(late.pixels, image)


def test_reattaching_twenty_times(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name, lively(512))
    canvas = Canvas()
    revision = 0
    chance = random.Random(3)
    for _ in range(20):
        stream = server.render.WatchJob(render.WatchJobRequest(name=job.name, since_revision=revision))
        for _ in range(chance.randrange(1, 12)):
            event = next(stream, None)
            if event is None:
                break
            if event.HasField("snapshot"):
                canvas.begin(event.snapshot.window)
            if event.HasField("tile"):
                canvas.apply(event.tile)
            revision = event.revision
        stream.cancel()
    server.watch(job.name, canvas, since=revision)
    assert np.array_equal(canvas.pixels, server.image(job.name))


def test_nothing_new_nothing_sent(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name)
    ended = server.finish(job.name)
    request = render.WatchJobRequest(name=job.name, since_revision=ended.revision)
    events = [event.WhichOneof("event") for event in server.render.WatchJob(request)]
    assert events == ["snapshot", "ended"]
    request = render.WatchJobRequest(name=job.name, without_tiles=True)
    events = [event.WhichOneof("event") for event in server.render.WatchJob(request)]
    assert events == ["snapshot", "ended"]


def test_many_watchers_of_one_job(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name, lively())
    canvases = [Canvas() for _ in range(20)]
    threads = [threading.Thread(target=server.watch, args=(job.name, canvas)) for canvas in canvases]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    image = server.image(job.name)
    for canvas in canvases:
        assert np.array_equal(canvas.pixels, image)


def test_a_stalled_watcher_holds_nobody_up(server: Server) -> None:
    # 16 tiles of 48 KiB, each published with every one of six passes.
    name = server.create_scene(fog_scene(width=256, height=256, samples=16)).name
    settings = render.RenderSettings(tile_size=64, update_interval_seconds=0.05, pixel_type=render.PIXEL_TYPE_FLOAT)
    job = server.create_job(name, settings)
    stalled = server.render.WatchJob(render.WatchJobRequest(name=job.name))
    next(stalled)
    server.finish(job.name)
    # What it finds when it reads on is the newest state of each tile and not what has gone by; but for the few that
    # were on their way when it stalled (64 KiB of window at either end), each comes once.
    tiles = [event.tile for event in stalled if event.HasField("tile")]
    assert len(tiles) <= 16 + 8
    assert {tile.samples_per_pixel for tile in tiles[-16:]} == {16}


def test_a_watcher_with_its_own_cadence(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name, lively())
    request = render.WatchJobRequest(name=job.name, update_interval_seconds=3600)
    counts: dict[tuple[int, int], int] = {}
    canvas = Canvas()
    for event in server.render.WatchJob(request):
        if event.HasField("snapshot"):
            canvas.begin(event.snapshot.window)
        if event.HasField("tile"):
            canvas.apply(event.tile)
            key = (event.tile.window.x, event.tile.window.y)
            counts[key] = counts.get(key, 0) + 1
    assert max(counts.values()) <= 2
    assert np.array_equal(canvas.pixels, server.image(job.name))
    for bad in (-1.0, float("nan"), 1e9):
        with pytest.raises(grpc.RpcError) as caught:
            list(server.render.WatchJob(render.WatchJobRequest(name=job.name, update_interval_seconds=bad)))
        assert error_info(caught.value).reason == "INVALID_CADENCE"


def test_watchers_that_vanish_are_forgotten(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name, render.RenderSettings(samples_per_pixel=1 << 20))
    for _ in range(10):
        streams = [server.render.WatchJob(render.WatchJobRequest(name=job.name)) for _ in range(50)]
        for stream in streams[::2]:
            next(stream)
        for stream in streams:
            stream.cancel()
    server.render.CancelJob(render.CancelJobRequest(name=job.name))
    server.watch(job.name)
    while server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).watchers > 0:
        pass


def test_largest_tiles_stay_below_the_message_limit(server: Server) -> None:
    name = server.create_scene(fog_scene(width=256, height=256, samples=1)).name
    for pixel_type in (render.PIXEL_TYPE_HALF, render.PIXEL_TYPE_FLOAT):
        settings = render.RenderSettings(tile_size=128, pixel_type=pixel_type)
        job = server.create_job(name, settings)
        sizes = [
            event.ByteSize()
            for event in server.render.WatchJob(render.WatchJobRequest(name=job.name))
            if event.HasField("tile")
        ]
        assert sizes
        assert max(sizes) < server.limit("max_tile_message_bytes")


def test_tiles_are_valid_exr_with_the_films_windows(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name, render.RenderSettings(tile_size=32))
    windows = set()
    for event in server.render.WatchJob(render.WatchJobRequest(name=job.name)):
        if event.HasField("tile"):
            window, pixels = decode(event.tile.exr)
            assert pixels.shape == (window.height, window.width, 3)
            assert np.all(np.isfinite(pixels))
            windows.add((window.x, window.y, window.width, window.height))
    assert windows == {(0, 0, 32, 32), (32, 0, 32, 32), (0, 32, 32, 16), (32, 32, 32, 16)}
