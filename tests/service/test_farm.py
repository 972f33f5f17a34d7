"""Leased jobs: two servers, one that has the job and one that performs its tasks."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import farm_pb2 as farm
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene_messages
from fogbank._generated.v1 import server_pb2

from tests.service.harness import Server, error_info, fog_scene, new_request_id

ENDED = (render.JOB_STATE_SUCCEEDED, render.JOB_STATE_FAILED, render.JOB_STATE_CANCELLED)
SETTINGS = {
    "volpath": render.RenderSettings(integrator="volpath", pixel_type=render.PIXEL_TYPE_FLOAT),
    "radiance-cache": render.RenderSettings(
        integrator="radiance-cache", pixel_type=render.PIXEL_TYPE_FLOAT, error=0.3, samples_per_pixel=8
    ),
    "photon-beams": render.RenderSettings(
        integrator="photon-beams", pixel_type=render.PIXEL_TYPE_FLOAT, samples_per_pixel=1
    ),
}
# Records want a medium that scatters in all directions alike.
SCENE = fog_scene().replace(b'<phase type="hg"><float name="g" value="0.7"/></phase>', b'<phase type="isotropic"/>')


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Who performs."""
    worker = Server(tmp_path_factory.mktemp("worker"), "--threads", "2")
    worker.create_scene(SCENE)
    yield worker
    assert worker.stop() == 0


@pytest.fixture(scope="module")
def isotropic(server: Server) -> scene_messages.Scene:
    """The scene of these tests, at the coordinator."""
    return server.create_scene(SCENE)


def build_id(server: Server) -> str:
    """By GetCapabilities."""
    return server.server.GetCapabilities(server_pb2.GetCapabilitiesRequest()).build_id


class Farm:
    """Carries messages between a job's server and a worker."""

    def __init__(self, coordinator: Server, worker: Server, job: render.Job, *, trip_seconds: float = 0) -> None:
        """Nothing is opened yet."""
        self.trip_seconds = trip_seconds
        self.coordinator = coordinator
        self.worker = worker
        self.job = job
        self.name = new_request_id()
        self.log = ""
        self.replica = ""
        self.stage = 0
        self.own_tasks = 0
        self.leased_tasks = 0

    def lease(self, wait: float = 5) -> farm.LeaseTasksResponse:
        """The next tasks."""
        answer = self.coordinator.farm.LeaseTasks(
            farm.LeaseTasksRequest(
                job=self.job.name,
                coordinator=self.name,
                max_tasks=8,
                wait_seconds=wait,
                known_stage=self.stage,
                trip_seconds=self.trip_seconds,
            )
        )
        self.stage = answer.stage
        self.own_tasks = answer.own_tasks
        self.leased_tasks += len(answer.tasks)
        return answer

    def open(self, log: str, build: str | None = None) -> farm.OpenReplicaResponse:
        """A replica that follows this log."""
        return self.worker.farm.OpenReplica(
            farm.OpenReplicaRequest(
                scene=self.job.scene,
                settings=self.job.settings,
                log=log,
                build_id=build_id(self.coordinator) if build is None else build,
            )
        )

    def follow(self, log: str) -> None:
        """Brings the replica to the log's end."""
        if log != self.log:
            self.log = log
            self.replica = self.open(log).replica
        length = self.open(log).log_length
        while True:
            answer = self.coordinator.farm.ReadJobLog(farm.ReadJobLogRequest(job=self.job.name, log=log, first=length))
            if not answer.entries:
                return
            request = farm.AdvanceReplicaRequest(replica=self.replica, entries=answer.entries)
            length = self.worker.farm.AdvanceReplica(request).log_length
            assert length == answer.entries[-1].index + 1

    def perform(self, tasks: Iterable[farm.LeasedTask], log_length: int) -> list[farm.TaskResultPart]:
        """The parts of the tasks' results."""
        request = farm.PerformTasksRequest(replica=self.replica, log_length=log_length, tasks=tasks)
        return [response.part for response in self.worker.farm.PerformTasks(request)]

    def complete(self, parts: Iterable[farm.TaskResultPart], log: str | None = None) -> farm.CompleteTasksResponse:
        """Hands results in."""

        def messages() -> Iterator[farm.CompleteTasksRequest]:
            yield farm.CompleteTasksRequest(job=self.job.name, log=self.log if log is None else log)
            for part in parts:
                yield farm.CompleteTasksRequest(part=part)

        return self.coordinator.farm.CompleteTasks(messages())

    def step(self) -> bool:
        """Some tasks from their lease to their completion; False when the job has ended."""
        answer = self.lease()
        if answer.state in ENDED:
            return False
        if answer.tasks:
            self.follow(answer.log)
            done = self.complete(self.perform(answer.tasks, answer.log_length))
            assert done.accepted + done.ignored == len(answer.tasks)
        return True

    def run(self) -> render.Job:
        """To the end."""
        while self.step():
            pass
        return self.coordinator.finish(self.job.name)


@pytest.mark.parametrize("integrator", SETTINGS)
def test_a_worker_brings_the_coordinators_own_bits(tmp_path: Path, worker: Server, integrator: str) -> None:
    # Each in an empty cache.
    images = []
    for leased in (False, True):
        server = Server(tmp_path / f"leased-{leased}", "--threads", "2")
        job = server.create_job(server.create_scene(SCENE).name, SETTINGS[integrator], leased=leased)
        assert job.leased == leased
        ended = Farm(server, worker, job).run() if leased else server.finish(job.name)
        images.append((server.image(job.name), ended.result.records_new, ended.result.samples))
        assert ended.result.rays > 0
        assert ended.result.render_cpu_seconds > 0
        assert server.stop() == 0
    assert np.array_equal(images[0][0], images[1][0])
    assert images[0][1:] == images[1][1:]
    assert (images[0][1] > 0) == (integrator == "radiance-cache")


@pytest.mark.parametrize("trip_seconds", [0.002, 10])
@pytest.mark.parametrize("integrator", ["volpath", "radiance-cache"])
def test_a_coordinator_performs_what_is_less_than_a_trip(
    tmp_path: Path, worker: Server, integrator: str, trip_seconds: float
) -> None:
    images = []
    for leased in (False, True):
        server = Server(tmp_path / f"leased-{leased}", "--threads", "2")
        job = server.create_job(server.create_scene(SCENE).name, SETTINGS[integrator], leased=leased)
        driver = Farm(server, worker, job, trip_seconds=trip_seconds)
        ended = driver.run() if leased else server.finish(job.name)
        images.append((server.image(job.name), ended.result.records_new, ended.result.samples))
        assert ended.result.rays > 0
        assert server.stop() == 0
    assert np.array_equal(images[0][0], images[1][0])
    assert images[0][1:] == images[1][1:]
    assert driver.own_tasks > 0
    if trip_seconds == 10:
        assert driver.leased_tasks == 0


def test_duplicates_latecomers_and_poison(server: Server, worker: Server, isotropic: scene_messages.Scene) -> None:
    job = server.create_job(isotropic.name, SETTINGS["volpath"], leased=True)
    plain = server.create_job(isotropic.name, SETTINGS["volpath"])
    dice = random.Random(1)
    driver = Farm(server, worker, job)
    late: list[farm.TaskResultPart] = []
    while (answer := driver.lease()).state not in ENDED:
        driver.follow(answer.log)
        parts = driver.perform(answer.tasks, answer.log_length) if answer.tasks else []
        dice.shuffle(parts)
        for part in parts:
            poisoned = farm.TaskResultPart()
            poisoned.CopyFrom(part)
            poisoned.data = part.data[:-8] + b"\xff" * 8  # the last sum is not a number
            refused = driver.complete([poisoned])
            assert refused.accepted == refused.ignored == 0
            assert [one.reason for one in refused.refused] == ["POISONED_RESULT"]
            assert (refused.refused[0].stage, refused.refused[0].index) == (part.stage, part.index)
            assert driver.complete([part, part]) == farm.CompleteTasksResponse(accepted=1, ignored=1)
        assert driver.complete(late) == farm.CompleteTasksResponse(ignored=len(late))
        late = parts
    server.finish(job.name)
    server.finish(plain.name)
    assert np.array_equal(server.image(job.name), server.image(plain.name))


def test_another_coordinator_gets_all_that_is_not_complete(
    server: Server, worker: Server, isotropic: scene_messages.Scene
) -> None:
    job = server.create_job(isotropic.name, SETTINGS["volpath"], leased=True)
    first = Farm(server, worker, job)
    leased = first.lease()
    assert leased.tasks
    assert len(leased.tasks) <= leased.stage_tasks
    first.follow(leased.log)
    assert first.complete(first.perform(leased.tasks[:1], leased.log_length)).accepted == 1
    second = Farm(server, worker, job)
    second.log, second.replica = first.log, first.replica
    seen: set[int] = set()
    while len(seen) < leased.stage_tasks - 1:
        answer = second.lease()
        assert answer.stage == leased.stage
        seen |= {task.index for task in answer.tasks}
    assert leased.tasks[0].index not in seen
    second.name = new_request_id()
    second.stage = 0
    second.run()


def test_waiting_pausing_and_cancelling(server: Server, worker: Server, isotropic: scene_messages.Scene) -> None:
    endless = render.RenderSettings(samples_per_pixel=1 << 20)
    job = server.create_job(isotropic.name, endless, leased=True)
    driver = Farm(server, worker, job)
    while (answer := driver.lease(wait=0)).tasks or answer.stage_tasks == 0:
        driver.log = answer.log
    server.render.PauseJob(render.PauseJobRequest(name=job.name))
    other = Farm(server, worker, job)
    assert not other.lease(wait=0.2).tasks
    server.render.ResumeJob(render.ResumeJobRequest(name=job.name))
    assert other.lease().tasks
    # All tasks are out, so that the next call waits, until the job is cancelled.
    while other.lease(wait=0).tasks:
        pass
    states = []
    waiting = threading.Thread(target=lambda: states.append(other.lease(wait=30).state))
    waiting.start()
    time.sleep(0.2)
    server.render.CancelJob(render.CancelJobRequest(name=job.name))
    waiting.join()
    assert server.watch(job.name).state == render.JOB_STATE_CANCELLED
    assert other.lease().state == render.JOB_STATE_CANCELLED
    assert states[0] in (render.JOB_STATE_RUNNING, render.JOB_STATE_CANCELLED)


def test_a_cancelled_call_stops_and_the_worker_goes_on(
    server: Server, worker: Server, isotropic: scene_messages.Scene
) -> None:
    # Tiles of many samples.
    settings = render.RenderSettings(samples_per_pixel=1 << 20, width=256, height=256, tile_size=128)
    job = server.create_job(isotropic.name, settings, leased=True)
    driver = Farm(server, worker, job)
    for _ in range(3):
        assert driver.step()
    answer = driver.lease()
    driver.follow(answer.log)
    call = worker.farm.PerformTasks(
        farm.PerformTasksRequest(replica=driver.replica, log_length=answer.log_length, tasks=answer.tasks)
    )
    time.sleep(0.1)
    call.cancel()
    # The threads are free again, and the tasks can be performed all the same.
    parts = driver.perform(answer.tasks, answer.log_length)
    assert driver.complete(parts).accepted == len(answer.tasks)
    worker.farm.CloseReplica(farm.CloseReplicaRequest(replica=driver.replica))
    with pytest.raises(grpc.RpcError) as caught:
        driver.perform(answer.tasks, answer.log_length)
    assert error_info(caught.value).reason == "REPLICA_NOT_FOUND"
    server.render.CancelJob(render.CancelJobRequest(name=job.name))
    server.watch(job.name)


def test_a_restarted_coordinator_goes_on_with_another_log(
    own_server: Server, worker: Server, server: Server, isotropic: scene_messages.Scene
) -> None:
    settings = SETTINGS["volpath"]
    plain = server.create_job(isotropic.name, settings)
    job = own_server.create_job(own_server.create_scene(SCENE).name, settings, leased=True)
    driver = Farm(own_server, worker, job)
    assert driver.step()
    old_log = driver.log
    own_server.kill()
    again = Server(own_server.data)
    driver = Farm(again, worker, job)
    assert driver.step()
    assert driver.log != old_log
    stale: list[Callable[[], object]] = [
        lambda: driver.complete([farm.TaskResultPart(last=True)], log=old_log),
        lambda: again.farm.ReadJobLog(farm.ReadJobLogRequest(job=job.name, log=old_log)),
    ]
    for call in stale:
        with pytest.raises(grpc.RpcError) as caught:
            call()
        assert error_info(caught.value).reason == "LOG_CHANGED"
    driver.run()
    server.finish(plain.name)
    assert np.array_equal(again.image(job.name), server.image(plain.name))
    assert again.stop() == 0


def test_bad_requests_are_refused_with_their_reason(
    server: Server, worker: Server, isotropic: scene_messages.Scene
) -> None:
    job = server.create_job(isotropic.name, SETTINGS["volpath"], leased=True)
    plain = server.create_job(isotropic.name, SETTINGS["volpath"])
    driver = Farm(server, worker, job)
    answer = driver.lease()
    driver.follow(answer.log)
    entry = server.farm.ReadJobLog(farm.ReadJobLogRequest(job=job.name, log=answer.log)).entries[0]
    damaged = farm.LeasedTask(stage=answer.stage, index=0, input=answer.tasks[0].input[:-1])
    broken = farm.JobLogEntry(index=1, sha256=entry.sha256, data=entry.data[:-1])
    gap = farm.JobLogEntry(index=7, sha256=entry.sha256, data=entry.data)
    part = farm.TaskResultPart(stage=answer.stage, index=0, offset=5, last=True)

    def lease(
        name: str = job.name,
        coordinator: str = "me",
        max_tasks: int = 1,
        wait_seconds: float = 0,
        trip_seconds: float = 0,
    ) -> None:
        server.farm.LeaseTasks(
            farm.LeaseTasksRequest(
                job=name,
                coordinator=coordinator,
                max_tasks=max_tasks,
                wait_seconds=wait_seconds,
                trip_seconds=trip_seconds,
            )
        )

    def perform(*tasks: farm.LeasedTask, replica: str = driver.replica, log_length: int = 1) -> None:
        request = farm.PerformTasksRequest(replica=replica, log_length=log_length, tasks=tasks)
        list(worker.farm.PerformTasks(request))

    def advance(replica: str, *entries: farm.JobLogEntry) -> None:
        worker.farm.AdvanceReplica(farm.AdvanceReplicaRequest(replica=replica, entries=entries))

    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: lease(max_tasks=0), "INVALID_LEASE"),
        (lambda: lease(wait_seconds=-1), "INVALID_LEASE"),
        (lambda: lease(wait_seconds=float("nan")), "INVALID_LEASE"),
        (lambda: lease(trip_seconds=-1), "INVALID_LEASE"),
        (lambda: lease(trip_seconds=float("nan")), "INVALID_LEASE"),
        (lambda: lease(coordinator="a b"), "INVALID_LEASE"),
        (lambda: lease(name="jobs/x"), "INVALID_NAME"),
        (lambda: lease(name="jobs/" + 24 * "0"), "JOB_NOT_FOUND"),
        (lambda: lease(name=plain.name), "JOB_NOT_LEASED"),
        (lambda: driver.complete([part]), "INVALID_RESULT"),
        (lambda: driver.complete([farm.TaskResultPart()]), "INVALID_RESULT"),
        (lambda: driver.complete([farm.TaskResultPart(last=True, seconds=float("nan"))]), "INVALID_RESULT"),
        (lambda: server.farm.CompleteTasks(iter([])), "INVALID_RESULT"),
        (
            lambda: server.farm.ReadJobLog(farm.ReadJobLogRequest(job=job.name, log=answer.log, first=99)),
            "INVALID_OFFSET",
        ),
        (lambda: driver.open("a log", build="another"), "BUILD_MISMATCH"),
        (lambda: driver.open(""), "INVALID_REPLICA"),
        (perform, "INVALID_TASK"),
        (lambda: perform(damaged), "INVALID_TASK"),
        (lambda: perform(answer.tasks[0], log_length=9), "REPLICA_BEHIND"),
        (lambda: perform(answer.tasks[0], replica="replicas/" + 24 * "0"), "REPLICA_NOT_FOUND"),
        (lambda: perform(answer.tasks[0], replica=driver.open("another log").replica, log_length=0), "REPLICA_BEHIND"),
        (lambda: advance(driver.replica, gap), "REPLICA_BEHIND"),
        (lambda: advance(driver.replica, broken), "INVALID_LOG"),
        (lambda: advance(driver.replica, entry), "REPLICA_NOT_FOUND"),  # the damaged entry closed it
    ]
    for call, reason in calls:
        with pytest.raises(grpc.RpcError) as caught:
            call()
        assert error_info(caught.value).reason == reason
    assert driver.complete([farm.TaskResultPart(stage=99, last=True)]).ignored == 1
    server.render.CancelJob(render.CancelJobRequest(name=job.name))
