"""What was acknowledged outlives the server: unfinished jobs go on, to the same bits; damage costs time only."""

from __future__ import annotations

import sqlite3
import subprocess
import time
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import server_pb2
from fogbank.paths import server_binary

from tests.service.harness import Canvas, Pixels, Server, error_info, fog_scene, new_request_id

# So small a film takes a checkpoint about every two seconds of rendering (1 % of render time); this is twice as long.
LONG = render.RenderSettings(width=32, samples_per_pixel=600, pixel_type=render.PIXEL_TYPE_FLOAT)
ENDLESS = render.RenderSettings(samples_per_pixel=1 << 20)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Pixels:
    """The picture of LONG, never interrupted."""
    server = Server(tmp_path_factory.mktemp("reference"))
    job = server.create_job(server.create_scene(fog_scene()).name, LONG)
    server.finish(job.name)
    image = server.image(job.name)
    assert server.stop() == 0
    return image


def checkpoint(server: Server, name: str) -> Path:
    """Where the checkpoint of a job lies."""
    return server.data / f"{name}.checkpoint"


def wait_for_checkpoint(server: Server, name: str) -> None:
    """Until there is one."""
    while not checkpoint(server, name).exists():
        assert server.job(name).state in (render.JOB_STATE_QUEUED, render.JOB_STATE_RUNNING)
        time.sleep(0.02)


def start_long_job(server: Server) -> str:
    """A job of LONG that has a checkpoint."""
    job = server.create_job(server.create_scene(fog_scene()).name, LONG)
    wait_for_checkpoint(server, job.name)
    return job.name


def test_a_killed_job_goes_on_from_its_checkpoint_to_the_same_bits(own_server: Server, reference: Pixels) -> None:
    name = start_long_job(own_server)
    own_server.kill()
    again = Server(own_server.data)
    canvas = Canvas()
    first = next(iter(again.render.WatchJob(render.WatchJobRequest(name=name)))).snapshot.job
    assert first.restarts == 1
    ended = again.watch(name, canvas)
    assert ended.state == render.JOB_STATE_SUCCEEDED, ended.error
    # What it told of itself after the restart began with the passes of the checkpoint.
    assert ended.result.samples == 32 * 24 * 600
    assert "goes on after" in again.log_path.read_text()
    assert np.array_equal(again.image(name), reference)
    assert np.array_equal(canvas.pixels, reference)
    assert not checkpoint(again, name).exists()
    assert again.stop() == 0


def test_a_damaged_checkpoint_costs_time_only(own_server: Server, reference: Pixels) -> None:
    name = start_long_job(own_server)
    own_server.kill()
    data = bytearray(checkpoint(own_server, name).read_bytes())
    data[len(data) // 2] ^= 4
    checkpoint(own_server, name).write_bytes(data)
    again = Server(own_server.data)
    again.finish(name)
    assert "begins again" in again.log_path.read_text()
    assert np.array_equal(again.image(name), reference)
    assert again.stop() == 0


def test_a_server_that_ends_suspends_its_jobs(own_server: Server, reference: Pixels) -> None:
    name = start_long_job(own_server)
    waiting = own_server.create_job(own_server.job(name).scene, LONG)
    watcher = own_server.render.WatchJob(render.WatchJobRequest(name=name))
    next(watcher)
    own_server.process.terminate()
    with pytest.raises(grpc.RpcError) as caught:
        for event in watcher:
            assert event.WhichOneof("event") != "ended"
    assert caught.value.code() == grpc.StatusCode.UNAVAILABLE
    assert error_info(caught.value).reason == "SHUTTING_DOWN"
    assert own_server.stop() == 0
    again = Server(own_server.data)
    for job in (name, waiting.name):
        assert again.finish(job).restarts == 1
        assert np.array_equal(again.image(job), reference)
    assert again.stop() == 0


def test_a_watcher_that_returns_misses_nothing(own_server: Server, reference: Pixels) -> None:
    name = start_long_job(own_server)
    canvas = Canvas()
    revision = 0
    for event in own_server.render.WatchJob(render.WatchJobRequest(name=name)):
        revision = event.revision
        if event.HasField("snapshot"):
            canvas.begin(event.snapshot.window)
        if event.HasField("tile"):
            canvas.apply(event.tile)
        if event.HasField("progress"):
            break
    own_server.kill()
    again = Server(own_server.data)
    ended = again.watch(name, canvas, since=revision)
    assert ended.revision > revision
    assert np.array_equal(canvas.pixels, reference)
    assert again.stop() == 0


def test_an_acknowledged_cancel_holds(own_server: Server) -> None:
    scene = own_server.create_scene(fog_scene()).name
    names = [own_server.create_job(scene, ENDLESS).name for _ in range(20)]
    for name in names:
        own_server.render.CancelJob(render.CancelJobRequest(name=name))
    own_server.kill()
    again = Server(own_server.data)
    for name in names:
        job = again.job(name)
        assert job.state == render.JOB_STATE_CANCELLED
        assert job.error.code == grpc.StatusCode.CANCELLED.value[0]
    assert again.stop() == 0


def test_every_acknowledged_job_is_there_and_none_twice(own_server: Server) -> None:
    scene = own_server.create_scene(fog_scene()).name
    requests = [
        render.CreateJobRequest(request_id=new_request_id(), scene=scene, settings=render.RenderSettings(seed=seed))
        for seed in range(20)
    ]
    names = [own_server.render.CreateJob(request).job.name for request in requests]
    own_server.kill()
    again = Server(own_server.data)
    assert [again.render.CreateJob(request).job.name for request in requests] == names
    for name in names:
        again.finish(name)
    assert len(again.render.ListJobs(render.ListJobsRequest(page_size=200)).jobs) == len(names)
    assert again.stop() == 0


def test_pause_holds_a_job_over_a_restart(own_server: Server, reference: Pixels) -> None:
    name = start_long_job(own_server)
    watcher = own_server.render.WatchJob(render.WatchJobRequest(name=name, without_tiles=True))
    # Now it watches: one that comes later hears of the pause by its snapshot.
    assert not next(watcher).snapshot.job.progress.paused
    paused = own_server.render.PauseJob(render.PauseJobRequest(name=name)).job
    assert paused.state == render.JOB_STATE_PAUSED
    assert next(event for event in watcher if event.HasField("progress") and event.progress.paused)
    status = server_pb2.GetServerStatusRequest()
    while own_server.server.GetServerStatus(status).busy_threads > 0:
        time.sleep(0.01)
    rays = own_server.job(name).progress.rays
    time.sleep(0.2)
    assert own_server.job(name).progress.rays == rays
    assert own_server.server.GetServerStatus(status).jobs.paused == 1
    own_server.kill()
    again = Server(own_server.data)
    assert again.job(name).state == render.JOB_STATE_PAUSED
    resumed = again.render.ResumeJob(render.ResumeJobRequest(name=name)).job
    assert resumed.state in (render.JOB_STATE_QUEUED, render.JOB_STATE_RUNNING)
    for _ in range(3):  # in the middle of tiles
        time.sleep(0.1)
        again.render.PauseJob(render.PauseJobRequest(name=name))
        again.render.ResumeJob(render.ResumeJobRequest(name=name))
    canvas = Canvas()
    ended = again.watch(name, canvas)
    assert ended.state == render.JOB_STATE_SUCCEEDED
    assert np.array_equal(canvas.pixels, reference)
    assert again.render.PauseJob(render.PauseJobRequest(name=name)).job == ended
    assert again.stop() == 0


def test_a_paused_job_can_be_cancelled(own_server: Server) -> None:
    name = own_server.create_job(own_server.create_scene(fog_scene()).name, ENDLESS).name
    own_server.render.PauseJob(render.PauseJobRequest(name=name))
    own_server.render.CancelJob(render.CancelJobRequest(name=name))
    assert own_server.watch(name).state == render.JOB_STATE_CANCELLED


def test_jobs_of_an_embedded_server_end_with_it(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--exit-with-stdin")
    name = server.create_job(server.create_scene(fog_scene()).name, ENDLESS).name
    server.kill()
    again = Server(tmp_path / "data", "--exit-with-stdin")
    ended = again.watch(name)
    assert ended.state == render.JOB_STATE_CANCELLED
    assert "ended before the job" in ended.error.message
    later = again.create_job(ended.scene, ENDLESS).name
    watcher = again.render.WatchJob(render.WatchJobRequest(name=later, without_tiles=True))
    next(watcher)
    again.process.terminate()
    assert list(watcher)[-1].ended.job.state == render.JOB_STATE_CANCELLED
    assert again.stop() == 0


def finished_jobs(server: Server, count: int) -> list[str]:
    """Jobs that are done, and the server killed."""
    scene = server.create_scene(fog_scene(samples=1)).name
    names = [server.create_job(scene).name for _ in range(count)]
    for name in names:
        server.finish(name)
    server.kill()
    return names


def test_a_damaged_row_is_passed_over(own_server: Server) -> None:
    names = finished_jobs(own_server, 5)
    with sqlite3.connect(own_server.data / "jobs" / "jobs.sqlite") as database:
        database.execute("UPDATE jobs SET description = CAST(description || x'00' AS BLOB) WHERE name = ?", (names[2],))
    database.close()
    again = Server(own_server.data)
    assert "a row is damaged" in again.log_path.read_text()
    left = {job.name for job in again.render.ListJobs(render.ListJobsRequest(page_size=200)).jobs}
    assert left == set(names) - {names[2]}
    for name in left:
        again.download(name)
    # Its picture is nobody's, but nothing is removed that might be missed.
    assert (again.data / f"{names[2]}.exr").exists()
    assert again.stop() == 0


@pytest.mark.parametrize("offset", [0, 40, 4096 + 8, 3 * 4096])
def test_a_damaged_database_is_kept_aside(own_server: Server, offset: int) -> None:
    names = finished_jobs(own_server, 5)
    path = own_server.data / "jobs" / "jobs.sqlite"
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    database.close()
    data = bytearray(path.read_bytes())
    for position in range(offset, min(offset + 64, len(data))):
        data[position] ^= 0xA5
    path.write_bytes(data)
    again = Server(own_server.data)
    left = {job.name for job in again.render.ListJobs(render.ListJobsRequest(page_size=200)).jobs}
    assert left <= set(names)
    for name in left:
        again.download(name)
    if left != set(names):
        assert "damaged" in again.log_path.read_text()
    finish = again.create_job(again.create_scene(fog_scene(samples=1)).name)
    again.finish(finish.name)
    assert all((again.data / f"{name}.exr").exists() for name in names)
    assert again.stop() == 0


def test_a_database_of_the_future_is_left_alone(own_server: Server) -> None:
    finished_jobs(own_server, 1)
    path = own_server.data / "jobs" / "jobs.sqlite"
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    command: list[str | Path] = [server_binary(), "--listen", "127.0.0.1:0", "--data", own_server.data]
    failed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert failed.returncode == 1
    assert "newer fogbankd" in failed.stderr
    with sqlite3.connect(path) as database:
        assert database.execute("SELECT COUNT(*) FROM jobs").fetchone() == (1,)
    database.close()
