"""Jobs of the radiance cache after a kill -9: from their last pass, on the records that they had, to the same bits."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fogbank._generated.v1 import render_pb2 as render

from tests.service.harness import Pixels, Server, fog_scene

WIDTH, HEIGHT = 32, 24
# Longer than what the first checkpoint with a pass waits for: 1 % of the time is for them.
LONG = render.RenderSettings(
    integrator="radiance-cache", width=WIDTH, samples_per_pixel=700, pixel_type=render.PIXEL_TYPE_FLOAT
)
# Of a stage that takes seconds, and there are some.
FINE = render.RenderSettings(
    integrator="radiance-cache", width=64, samples_per_pixel=256, error=0.004, pixel_type=render.PIXEL_TYPE_FLOAT
)
# Two layers of two sums each; a checkpoint of the beginning has none.
FILM_BYTES = WIDTH * HEIGHT * 2 * 48

Outcome = tuple[render.Job, Pixels]


def uninterrupted(folder: Path, settings: render.RenderSettings) -> Outcome:
    """A job that nothing comes between."""
    server = Server(folder, "--threads", "2")
    job = server.finish(server.create_job(server.create_scene(fog_scene()).name, settings).name)
    image = server.image(job.name)
    assert server.stop() == 0
    return job, image


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """LONG, never interrupted."""
    return uninterrupted(tmp_path_factory.mktemp("long"), LONG)


@pytest.fixture(scope="module")
def fine(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """FINE, never interrupted."""
    return uninterrupted(tmp_path_factory.mktemp("fine"), FINE)


def start(server: Server, settings: render.RenderSettings) -> str:
    """A job of these settings."""
    return server.create_job(server.create_scene(fog_scene()).name, settings).name


def kill_when(server: Server, name: str, due: Callable[[render.Job], bool]) -> None:
    """Kills the server at a moment of the job, which must not have ended."""
    while True:
        job = server.job(name)
        assert job.state in (render.JOB_STATE_QUEUED, render.JOB_STATE_RUNNING), "it ended before it could be killed"
        if due(job):
            server.kill()
            return
        time.sleep(0.01)


def passes_of(log: str) -> int:
    """Those that the server that came after went on from, by its own account."""
    found = re.search(r"goes on after (\d+) passes with the records that it had", log)
    assert found is not None, log
    return int(found[1])


def test_a_job_killed_in_its_passes_goes_on_to_the_same_bits(own_server: Server, long: Outcome) -> None:
    name = start(own_server, LONG)
    checkpoint = own_server.data / f"{name}.checkpoint"
    kill_when(own_server, name, lambda _: checkpoint.exists() and checkpoint.stat().st_size > FILM_BYTES)
    again = Server(own_server.data, "--threads", "2")
    first = next(iter(again.render.WatchJob(render.WatchJobRequest(name=name)))).snapshot.job
    ended = again.finish(name)
    passes = passes_of(again.log_path.read_text())
    assert passes > 0
    # It has these passes in its film before it renders any.
    assert first.progress.passes_done == 0 or first.progress.passes_done >= passes
    whole, image = long
    assert ended.result.samples == whole.result.samples
    assert ended.result.records_new == whole.result.records_new
    assert np.array_equal(again.image(name), image)
    # Counted are those of the passes of the checkpoint and of the ones after it, as if there had been no kill.
    assert ended.progress.passes_done == whole.progress.passes_done
    assert not checkpoint.exists()
    assert again.stop() == 0


@pytest.mark.parametrize("passes", [0, 1])
def test_a_job_killed_in_a_fill_makes_no_record_twice(own_server: Server, fine: Outcome, passes: int) -> None:
    """In the fill before the first pass; in a later one. Of either, records are on the disk."""
    name = start(own_server, FINE)
    segments = own_server.data / "caches" / "fields"

    def due(job: render.Job) -> bool:
        fills = job.progress.phase == render.JOB_PHASE_FILLING and job.progress.passes_done >= passes
        return fills and any(segments.glob("*/segments/*"))

    kill_when(own_server, name, due)
    again = Server(own_server.data, "--threads", "2")
    ended = again.finish(name)
    passes_of(again.log_path.read_text())
    whole, image = fine
    assert ended.result.records_new == whole.result.records_new
    assert np.array_equal(again.image(name), image)
    # The rays of the life before the kill are not counted; those of records on the disk are not traced again.
    assert ended.result.rays < whole.result.rays
    assert again.stop() == 0


def test_a_checkpoint_without_its_records_costs_time_only(own_server: Server) -> None:
    name = start(own_server, LONG)
    checkpoint = own_server.data / f"{name}.checkpoint"
    kill_when(own_server, name, lambda _: checkpoint.exists() and checkpoint.stat().st_size > FILM_BYTES)
    shutil.rmtree(own_server.data / "caches")
    again = Server(own_server.data, "--threads", "2")
    ended = again.finish(name)
    assert "begins again: records that it needs are gone" in again.log_path.read_text()
    assert ended.result.samples == WIDTH * HEIGHT * LONG.samples_per_pixel
    assert again.stop() == 0
