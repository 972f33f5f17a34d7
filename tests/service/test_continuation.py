"""Jobs of the radiance cache after a kill -9: from their last pass, on the records that they had, to the same bits."""

from __future__ import annotations

import re
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
    integrator="radiance-cache", width=WIDTH, samples_per_pixel=700, records=150, pixel_type=render.PIXEL_TYPE_FLOAT
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
