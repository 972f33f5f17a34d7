"""kill -9 at random moments under mixed load: what was acknowledged is there, and no picture is a wrong one."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import cache_pb2 as cache
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene

from tests.faults.conftest import FULL, Record
from tests.service.harness import Pixels, Server, fog_scene, new_request_id, sha256

KILLS = 50 if FULL else 4
LONGEST_LIFE_SECONDS = 3.0
RESTART_SECONDS = 5.0

# Pictures that do not depend on what others put into a cache, a short one and one of several passes and checkpoints.
PICTURES = [
    render.RenderSettings(width=width, samples_per_pixel=samples, seed=seed, pixel_type=render.PIXEL_TYPE_FLOAT)
    for width, samples in ((16, 2), (32, 64))
    for seed in (1, 2)
]
CACHED = render.RenderSettings(integrator="radiance-cache", width=16, samples_per_pixel=2)


class Load:
    """Clients that keep a server busy until it dies, and what it acknowledged."""

    def __init__(self) -> None:
        """Nothing was asked yet."""
        self.jobs: dict[str, tuple[render.CreateJobRequest, str]] = {}
        self.cancelled: set[str] = set()
        self.perhaps_cancelled: set[str] = set()
        """Cancels that were asked for; of some the server died before it could say so."""
        self.blobs: dict[str, int] = {}
        self._lock = threading.Lock()

    def run(self, server: Server, scene_name: str, seed: int) -> list[threading.Thread]:
        """Starts the clients; each ends with its first error."""

        def client(work: int) -> None:
            dice = random.Random(f"{seed}.{work}")
            try:
                while True:
                    (self._render, self._render, self._upload, self._fill)[work](server, scene_name, dice)
            except grpc.RpcError as error:
                assert error.code() in (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED), error
            except ValueError:
                pass  # the channel was closed

        threads = [threading.Thread(target=client, args=(work,)) for work in range(4)]
        for thread in threads:
            thread.start()
        return threads

    def _render(self, server: Server, scene_name: str, dice: random.Random) -> None:
        settings = dice.choice([*PICTURES, CACHED])
        request = render.CreateJobRequest(request_id=new_request_id(), scene=scene_name, settings=settings)
        name = server.render.CreateJob(request).job.name
        with self._lock:
            self.jobs[name] = (request, settings.integrator)
        if dice.random() < 0.2:
            with self._lock:
                self.perhaps_cancelled.add(name)
            if server.render.CancelJob(render.CancelJobRequest(name=name)).job.state != render.JOB_STATE_SUCCEEDED:
                with self._lock:
                    self.cancelled.add(name)
        elif dice.random() < 0.5:
            for _ in server.render.WatchJob(render.WatchJobRequest(name=name)):
                pass

    def _upload(self, server: Server, _: str, dice: random.Random) -> None:
        data = dice.randbytes(dice.randrange(1, 1 << 20))
        server.upload(data)
        with self._lock:
            self.blobs[sha256(data)] = len(data)

    def _fill(self, server: Server, scene_name: str, _: random.Random) -> None:
        for _report in server.caches.FillCache(cache.FillCacheRequest(scene=scene_name, settings=CACHED)):
            pass


def expected_pictures(folder: Path) -> list[Pixels]:
    """PICTURES by a server that is left alone."""
    server = Server(folder)
    name = server.create_scene(fog_scene()).name
    jobs = [server.create_job(name, settings).name for settings in PICTURES]
    for job in jobs:
        server.finish(job)
    images = [server.image(job) for job in jobs]
    assert server.stop() == 0
    return images


@pytest.mark.timeout(1800)
def test_random_kills(tmp_path: Path, record: Record) -> None:
    expected = expected_pictures(tmp_path / "expected")
    dice = random.Random(20261122)
    load = Load()
    server = Server(tmp_path / "data", "--threads", "2")
    scene_name = server.create_scene(fog_scene()).name
    slowest = 0.0
    for kill in range(KILLS):
        clients = load.run(server, scene_name, kill)
        time.sleep(dice.uniform(0.0, LONGEST_LIFE_SECONDS))
        server.process.kill()
        server.process.wait()
        for client in clients:
            client.join()
        server.channel.close()
        start = time.monotonic()
        server = Server(server.data, "--threads", "2")
        slowest = max(slowest, time.monotonic() - start)

        # Idempotent, hence the same jobs; and nothing that was cancelled goes on.
        for name, (request, _) in load.jobs.items():
            assert server.render.CreateJob(request).job.name == name
        for name in load.cancelled:
            assert server.job(name).state in (render.JOB_STATE_CANCELLED, render.JOB_STATE_SUCCEEDED)
        for digest, size in load.blobs.items():
            presence = server.scenes.QueryBlob(scene.QueryBlobRequest(sha256=digest))
            assert presence.complete
            assert presence.committed_size == size

    wrong = 0
    unfinished = []
    for name, (request, integrator) in load.jobs.items():
        job = server.watch(name)
        if job.state != render.JOB_STATE_SUCCEEDED:
            if job.state != render.JOB_STATE_CANCELLED or name not in load.perhaps_cancelled:
                unfinished.append(f"{name}: {render.JobState.Name(job.state)}, {job.error}")
            continue
        image = server.image(name)
        if not integrator:
            wrong += not np.array_equal(image, expected[PICTURES.index(request.settings)])
        assert np.all(np.isfinite(image))
    assert server.stop() == 0
    record("kills", KILLS, KILLS)
    record("acknowledged jobs lost", len(unfinished), 0)
    record("wrong pictures", wrong, 0)
    record("slowest restart, seconds", slowest, RESTART_SECONDS)
    assert not unfinished, unfinished[:5]
    assert wrong == 0
    assert len(load.jobs) >= KILLS
