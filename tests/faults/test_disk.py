"""Disks that are full or can't be written to, directories that are taken, clocks that jump: faults C4 and C7."""

from __future__ import annotations

import os
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene
from fogbank.paths import server_binary

from tests.faults.conftest import Record
from tests.service.harness import Server, error_info, fog_scene

SMALL = render.RenderSettings(width=16, samples_per_pixel=1)
LARGE = render.RenderSettings(width=512, height=384, samples_per_pixel=1, pixel_type=render.PIXEL_TYPE_FLOAT)
ENDLESS = render.RenderSettings(samples_per_pixel=1 << 20)
DAY = 86400


def mount(*arguments: str | Path) -> None:
    """Skips the test, saying so, where this machine does not let us."""
    done = subprocess.run(["mount", *arguments], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"file systems can't be mounted here: {done.stderr.strip()}")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """An empty disk of 32 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount("-t", "tmpfs", "-o", "size=32m", "tmpfs", folder)
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


def reason(call: Callable[[], object]) -> str:
    """Why a call is refused."""
    with pytest.raises(grpc.RpcError) as caught:
        call()
    return str(error_info(caught.value).reason)


def start_fails(data: Path) -> str:
    """What a server that does not start says."""
    command: list[str | Path] = [server_binary(), "--listen", "127.0.0.1:0", "--data", data]
    failed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert failed.returncode == 1
    return failed.stderr


def test_a_full_disk(small_disk: Path, record: Record) -> None:
    server = Server(small_disk / "data", "--threads", "2")
    name = server.create_scene(fog_scene()).name
    before = server.create_job(name, SMALL).name
    server.finish(before)
    image = server.image(before)
    filler = small_disk / "filler"
    with filler.open("wb", buffering=0) as file, pytest.raises(OSError):
        while True:
            file.write(bytes(4096))

    refused = 0
    assert reason(lambda: server.upload(os.urandom(1 << 20))) == "DISK_FULL"
    for _ in range(20):
        try:
            ended = server.watch(server.create_job(name, LARGE).name)
            assert ended.state == render.JOB_STATE_FAILED
            assert "No space left" in ended.error.message or "full" in ended.error.message
        except grpc.RpcError as error:
            assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
            assert error_info(error).reason == "DISK_FULL"
        refused += 1
    # What is there can be read.
    assert np.array_equal(server.image(before), image)
    assert server.scenes.GetScene(scene.GetSceneRequest(name=name)).scene.name == name

    filler.unlink()
    server.upload(os.urandom(1 << 20))
    server.finish(server.create_job(name, LARGE).name)
    assert server.stop() == 0
    again = Server(server.data)
    assert np.array_equal(again.image(before), image)
    assert again.stop() == 0
    record("refused on a full disk, deaths", 20 - refused, 0)


def test_a_read_only_directory(small_disk: Path) -> None:
    server = Server(small_disk / "data")
    name = server.create_scene(fog_scene()).name
    job = server.create_job(name, SMALL).name
    server.finish(job)
    image = server.image(job)
    assert server.stop() == 0
    mount("-o", "remount,ro", small_disk)
    assert "Read-only file system" in start_fails(small_disk / "data")
    assert "Read-only file system" in start_fails(small_disk / "other")
    mount("-o", "remount,rw", small_disk)
    again = Server(small_disk / "data")
    assert np.array_equal(again.image(job), image)
    assert again.stop() == 0


def test_what_cannot_be_removed_is_not_said_to_be(tmp_path: Path) -> None:
    server = Server(tmp_path / "data")
    name = server.create_scene(fog_scene()).name
    folder = server.data / name
    locked = subprocess.run(["chattr", "+i", folder], capture_output=True, text=True, check=False)
    if locked.returncode != 0:
        pytest.skip(f"folders can't be locked here: {locked.stderr.strip()}")
    try:
        assert reason(lambda: server.scenes.DeleteScene(scene.DeleteSceneRequest(name=name))) == "STORAGE_ERROR"
        assert server.scenes.GetScene(scene.GetSceneRequest(name=name)).scene.name == name
    finally:
        subprocess.run(["chattr", "-i", folder], check=True)
    server.scenes.DeleteScene(scene.DeleteSceneRequest(name=name))
    server.kill()
    again = Server(server.data)
    with pytest.raises(grpc.RpcError):
        again.scenes.GetScene(scene.GetSceneRequest(name=name))
    assert again.stop() == 0


def test_one_server_a_directory(tmp_path: Path) -> None:
    server = Server(tmp_path / "data")
    assert "in use by another fogbankd" in start_fails(server.data)
    name = server.create_scene(fog_scene()).name
    server.finish(server.create_job(name, SMALL).name)
    server.kill()
    # The lock of one that was killed is nobody's.
    assert Server(server.data).stop() == 0


@pytest.mark.parametrize("jump", [DAY, -DAY])
def test_a_clock_that_jumps(tmp_path: Path, jump: int) -> None:
    offset = tmp_path / "offset"
    offset.write_bytes(struct.pack("q", 0))
    library = Path(server_binary()).with_name("libfogbank_clock.so")
    environment = {"LD_PRELOAD": str(library), "FOGBANK_CLOCK_OFFSET": str(offset)}
    server = Server(tmp_path / "data", "--threads", "2", environment=environment)
    name = server.create_scene(fog_scene()).name
    endless = server.create_job(name, ENDLESS).name
    stream = server.render.WatchJob(render.WatchJobRequest(name=endless, without_tiles=True))
    next(stream)
    created = server.job(endless).create_time.seconds
    with offset.open("r+b") as file:
        file.write(struct.pack("q", jump))
    start = time.monotonic()
    for _, event in zip(range(4), stream, strict=False):
        assert event.WhichOneof("event") in ("progress", "heartbeat")
    assert time.monotonic() - start < DAY / 10
    later = server.create_job(name, SMALL).name
    job = server.finish(later)
    assert abs(job.create_time.seconds - created - jump) < 3600
    assert 0 <= job.result.render_seconds < 3600
    server.render.CancelJob(render.CancelJobRequest(name=endless))
    assert server.watch(endless).state == render.JOB_STATE_CANCELLED
    server.kill()
    again = Server(server.data, environment=environment)
    assert {item.name for item in again.render.ListJobs(render.ListJobsRequest()).jobs} == {endless, later}
    again.image(later)
    again.finish(again.create_job(name, SMALL).name)
    assert again.stop() == 0
