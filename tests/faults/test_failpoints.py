"""Every named failpoint of the stores (server/core/failpoint.h), by kill, by delay and by error: faults C2.

A server that is killed there comes back with all that it acknowledged; one that is slow there is merely slow; one whose
disk is full there says so and goes on.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import cache_pb2 as cache
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene
from fogbank.errors import job_error
from fogbank.paths import server_binary

from tests.faults.conftest import FULL, Record
from tests.service.harness import Pixels, Server, error_info, new_request_id
from tests.service.test_caches import SMALL_BLOCK, cached_scene, settings

ROOT = Path(__file__).resolve().parents[2]
BINARY = Path(server_binary()).with_name("fogbankd_failpoints")
_NAME = re.compile(r'FOGBANK_FAILPOINT\("([a-z._]+)"\)')
NAMES = sorted({name for path in (ROOT / "server").rglob("*.cpp") for name in _NAME.findall(path.read_text())})
CHOSEN = NAMES if FULL else NAMES[5::19]
# The server cannot start, or ends its last job, without them: there is nobody to tell of an error.
NO_ERRORS = {"job.before_restore", "job.after_restore", "job.before_suspension"}
PATHS = render.RenderSettings(integrator="volpath", width=32, pixel_type=render.PIXEL_TYPE_FLOAT)


def paths(samples: int, seed: int) -> render.RenderSettings:
    """A picture that doesn't depend on what is in the cache."""
    message = render.RenderSettings()
    message.CopyFrom(PATHS)
    message.samples_per_pixel = samples
    message.seed = seed
    return message


PICTURE, LONG, ENDLESS = paths(2, 1), paths(64, 2), paths(1 << 20, 3)
CACHED = settings()


@dataclass
class Base:
    """A data directory with an unfinished job, to be copied, and what pictures must be."""

    data: Path
    scene: str
    long: str
    pictures: dict[int, Pixels]


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Base:
    """The server that made it was killed."""
    server = Server(tmp_path_factory.mktemp("base") / "data", "--threads", "2")
    name = server.create_scene(cached_scene()).name
    pictures = {}
    for picture in (PICTURE, LONG):
        job = server.create_job(name, picture).name
        server.finish(job)
        pictures[picture.seed] = server.image(job)
    long = server.create_job(name, LONG).name
    server.kill()
    return Base(server.data, name, long, pictures)


@dataclass
class Client:
    """Does everything that a server stores, and remembers what was acknowledged."""

    server: Server
    base: Base
    jobs: dict[str, render.CreateJobRequest] = field(default_factory=dict)
    cancelled: set[str] = field(default_factory=set)
    blobs: set[str] = field(default_factory=set)
    gone_scenes: set[str] = field(default_factory=set)
    gone_caches: set[str] = field(default_factory=set)
    refused: list[str] = field(default_factory=list)

    def run(self) -> bool:
        """Whether the server lived to the end."""
        steps: list[Callable[[], object]] = [
            self.upload,
            self.make_and_remove_scene,
            lambda: self.finish(PICTURE),
            self.cancel,
            self.caches,
            self.leave_unfinished,
        ]
        for step in steps:
            try:
                step()
            except grpc.RpcError as error:
                if error.code() in (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED):
                    return False
                assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED, error
                self.refused.append(str(error_info(error).reason))
        return True

    def create(self, settings: render.RenderSettings) -> str:
        """A job that is acknowledged."""
        request = render.CreateJobRequest(request_id=new_request_id(), scene=self.base.scene, settings=settings)
        name = self.server.render.CreateJob(request).job.name
        self.jobs[name] = request
        return name

    def finish(self, settings: render.RenderSettings) -> None:
        """A job to its end."""
        self.follow(self.create(settings))

    def follow(self, name: str) -> None:
        """A job to its end."""
        job = self.server.watch(name)
        if job.state == render.JOB_STATE_FAILED:
            self.refused.append(job_error(False, job.error).reason)

    def upload(self) -> None:
        """A file of several chunks."""
        self.blobs.add(self.server.upload(os.urandom(200_000)))

    def make_and_remove_scene(self) -> None:
        """A scene of its own."""
        name = self.server.create_scene(cached_scene(SMALL_BLOCK)).name
        self.server.scenes.DeleteScene(scene.DeleteSceneRequest(name=name))
        self.gone_scenes.add(name)

    def cancel(self) -> None:
        """A job that has not ended."""
        name = self.create(ENDLESS)
        self.server.render.PauseJob(render.PauseJobRequest(name=name))
        self.server.render.CancelJob(render.CancelJobRequest(name=name))
        self.cancelled.add(name)

    def caches(self) -> None:
        """Records of two fills, united, exported, and the cache removed."""
        for shift in (0.0, 0.5):
            camera = render.CameraOverride(to_world=looking_at_the_middle((shift, 0.0, 4.0)))
            self.server.fill(self.base.scene, CACHED, [camera])
        (made,) = [one.name for one in self.server.caches.ListCaches(cache.ListCachesRequest()).caches]
        self.server.caches.CollectCacheGarbage(cache.CollectCacheGarbageRequest())
        assert self.server.export(made)
        self.server.caches.DeleteCache(cache.DeleteCacheRequest(name=made))
        self.gone_caches.add(made)

    def leave_unfinished(self) -> None:
        """A job for the server to suspend."""
        name = self.create(ENDLESS)
        while (job := self.server.job(name)).progress.passes_done < 2 and job.state != render.JOB_STATE_FAILED:
            time.sleep(0.02)

    def check_picture(self, server: Server, name: str, settings: render.RenderSettings, errors: bool) -> None:
        """A job ends with the right picture or, where errors were made, with such an error."""
        job = server.watch(name)
        if errors and job.state == render.JOB_STATE_FAILED:
            assert job_error(False, job.error).reason == "DISK_FULL"
            return
        assert job.state == render.JOB_STATE_SUCCEEDED, job.error
        assert np.array_equal(server.image(name), self.base.pictures[settings.seed])

    def check(self, server: Server, *, errors: bool) -> None:
        """Holds a server, of the same data, to what was acknowledged."""
        for name, request in self.jobs.items():
            assert server.render.CreateJob(request).job.name == name
            if name in self.cancelled:
                assert server.watch(name).state == render.JOB_STATE_CANCELLED
            elif request.settings == ENDLESS:
                server.render.CancelJob(render.CancelJobRequest(name=name))
            elif request.settings == PICTURE:
                self.check_picture(server, name, PICTURE, errors)
        self.check_picture(server, self.base.long, LONG, errors)
        for digest in self.blobs:
            assert server.scenes.QueryBlob(scene.QueryBlobRequest(sha256=digest)).complete
        for name in self.gone_scenes:
            with pytest.raises(grpc.RpcError):
                server.scenes.GetScene(scene.GetSceneRequest(name=name))
        for name in self.gone_caches:
            with pytest.raises(grpc.RpcError):
                server.caches.GetCache(cache.GetCacheRequest(name=name))


def run(tmp_path: Path, base: Base, failpoints: str) -> tuple[Client, bool, str]:
    """The client against a server with failpoints, what came of it, and the server's log; then it is checked."""
    data = tmp_path / "data"
    shutil.copytree(base.data, data)
    environment = {"FOGBANK_FAILPOINTS": failpoints}
    try:
        server = Server(data, "--threads", "2", binary=BINARY, environment=environment)
    except AssertionError:
        # It fell before it was ready.
        lived, client = False, None
    else:
        client = Client(server, base)
        lived = client.run()
        lived = server.stop() == 0 and lived
    log = (data / "log").read_text()
    again = Server(data, "--threads", "2")
    client = client or Client(again, base)
    client.check(again, errors="error" in failpoints)
    # And everything works again.
    after = Client(again, base)
    after.upload()
    after.make_and_remove_scene()
    after.finish(PICTURE)
    assert not after.refused
    assert again.stop() == 0
    return client, lived, log


@pytest.mark.parametrize("name", CHOSEN)
def test_killed_there(tmp_path: Path, base: Base, name: str) -> None:
    # The first file is the one that says that the server is ready.
    _, lived, log = run(tmp_path, base, f"{name}=panic@3" if name.startswith("file.") else f"{name}=panic")
    assert f"failpoint {name}: panic" in log, "nothing comes by"
    assert not lived


@pytest.mark.parametrize("names", [CHOSEN[i : i + 6] for i in range(0, len(CHOSEN), 6)], ids=lambda names: names[0])
def test_slow_there(tmp_path: Path, base: Base, names: list[str]) -> None:
    # Several at once cost no more than one. Tasks are many.
    delays = {name: 5 if name == "job.before_task" else 50 for name in names}
    client, lived, log = run(tmp_path, base, ",".join(f"{name}=delay:{delay}" for name, delay in delays.items()))
    assert all(f"failpoint {name}: delay" in log for name in names)
    assert lived
    assert not client.refused


@pytest.mark.parametrize("name", [name for name in CHOSEN if name not in NO_ERRORS])
def test_disk_full_there(tmp_path: Path, base: Base, name: str) -> None:
    client, lived, log = run(tmp_path, base, f"{name}=error:ENOSPC@{2 if name.startswith('file.') else 1}")
    assert f"failpoint {name}: error" in log
    assert lived
    assert set(client.refused) <= {"DISK_FULL"}


def test_only_the_test_binary_has_them(record: Record) -> None:
    assert len(NAMES) >= 25
    with_them = BINARY.read_bytes()
    assert all(name.encode() in with_them for name in NAMES)
    without = Path(server_binary()).read_bytes()
    if b"FOGBANK_FAILPOINTS" in without:
        pytest.skip("this build has failpoints everywhere (preset dev or asan)")
    assert not any(name.encode() + b"\0" in without for name in NAMES)
    record("failpoints", -len(NAMES), -25)


def looking_at_the_middle(origin: tuple[float, float, float]) -> list[float]:
    """A camera's to_world, row by row, as Mitsuba's lookat makes it."""
    position = np.array(origin)
    forward = -position / np.linalg.norm(position)
    left = np.cross((0.0, 1.0, 0.0), forward)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, position], -1)
    return [float(value) for value in matrix.ravel()]
