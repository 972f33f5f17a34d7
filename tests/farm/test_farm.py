"""The short part of the farm's tests: two local workers make one machine's pictures. `make test-farm` does the rest."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import fogbank
import pytest
from distributed import Client, Future
from fogbank import RenderOptions, farm
from fogbank.farm.coordinator import Coordinator
from fogbank.farm.costs import BATCH_SECONDS, HANDLING_SECONDS, Costs, Trips
from fogbank.farm.job_log import JobLog
from fogbank.farm.parcels import LogSegment

from tests.farm.conftest import Expected, Record
from tests.farm.scenes import BEAMS, PATHS, RECORDS, assert_same_pictures, write_scene


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Two workers of one thread."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("workers")))
        with farm.local_cluster(2) as client:
            yield client


@pytest.mark.parametrize("options", [PATHS, RECORDS, BEAMS], ids=["volpath", "radiance-cache", "photon-beams"])
def test_a_farm_makes_the_pictures_of_one_machine(
    service: fogbank.Service,
    cluster: Client,
    tmp_path: Path,
    expected: Expected,
    record: Record,
    options: RenderOptions,
) -> None:
    path = write_scene(tmp_path / "scene")
    job = farm.render(service.load(path), cluster, **options)
    tiles = list(job.tiles())
    image = job.result()
    job.join_farm()
    alone = expected(options)
    assert_same_pictures(image, alone.image)
    assert tiles
    assert job.statistics is not None
    assert job.statistics.records_new == alone.records
    statistics = job.farm
    assert statistics.poisoned == statistics.lost == 0
    assert statistics.kinds["tile"].tasks > 0
    for kind, figures in statistics.kinds.items():
        if figures.tasks:
            moved = figures.input_bytes + figures.result_bytes
            record(f"bytes moved for each {kind} task", moved / figures.tasks, "B")
    if alone.records:
        record("bytes of the log for each record", statistics.log_bytes / alone.records, "B")


@pytest.mark.usefixtures("trips_as_measured")
def test_what_is_less_than_a_trip_is_done_by_the_server(
    service: fogbank.Service, cluster: Client, tmp_path: Path, expected: Expected, record: Record
) -> None:
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **RECORDS)
    image = job.result()
    job.join_farm()
    alone = expected(RECORDS)
    assert_same_pictures(image, alone.image)
    assert job.statistics is not None
    assert job.statistics.records_new == alone.records
    assert job.farm.own_tasks > 0
    assert job.farm.own_cpu_seconds > 0.0
    record("tasks that the server did itself", job.farm.own_tasks, "")
    record("tasks that travelled", sum(kind.tasks for kind in job.farm.kinds.values()), "")


def test_records_that_are_there_are_sent(service: fogbank.Service, cluster: Client, tmp_path: Path) -> None:
    path = write_scene(tmp_path / "scene")
    scene = service.load(path)
    with farm.Farm(cluster) as workers:
        for _ in range(2):
            job = workers.render(scene, **RECORDS)
            image = job.result()
            job.join_farm()
    with fogbank.connect(data=tmp_path / "alone", threads=2) as other:
        same = other.load(path)
        same.render(**RECORDS).wait()
        expected = same.render(**RECORDS)
        assert_same_pictures(image, expected.result())
    assert job.statistics is not None
    assert expected.statistics is not None
    assert job.statistics.records_reused == expected.statistics.records_reused > 0
    assert job.statistics.records_new == expected.statistics.records_new
    assert job.farm.records == job.statistics.records_reused + job.statistics.records_new


def test_large_entries_of_a_log_travel_by_themselves(service: fogbank.Service, cluster: Client) -> None:
    log = JobLog(service.connection, "jobs/any", "any")
    large, small = LogSegment(0, (bytes(100_000),)), LogSegment(1, (b"a", b"b"))
    log._segments = [large, small]
    first, second = log.segments(cluster, 0)
    assert isinstance(first, Future)
    assert first.result() == large
    assert second is small
    assert log.segments(cluster, 1) == log.segments(cluster, 2) == [small]
    assert log.segments(cluster, 3) == []


def test_a_farm_fills_the_cache_of_one_machine(service: fogbank.Service, cluster: Client, tmp_path: Path) -> None:
    path = write_scene(tmp_path / "scene")
    options = RenderOptions(integrator="radiance-cache", size=(32, 20), spp=4, error=0.3)
    cameras = [{"origin": (x, 0.0, 4.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0)} for x in (0.0, 1.0)]
    scene = service.load(path)
    reports = list(farm.fill_events(scene, cluster, cameras, **options))
    scene.cache.export(tmp_path / "farm.cache")
    with fogbank.connect(data=tmp_path / "alone", threads=2) as other:
        same = other.load(path)
        expected = same.cache.fill(cameras, **options)
        same.cache.export(tmp_path / "alone.cache")
    assert (tmp_path / "farm.cache").read_bytes() == (tmp_path / "alone.cache").read_bytes()
    last = reports[-1]
    assert (last.done, last.cameras_done, last.cameras_total) == (True, 2, 2)
    assert (last.records_reused, last.records_new) == (expected.records_reused, expected.records_new)
    assert last.records_new > 0
    # What it names is kept, for pictures.
    frame = scene.render(**RenderOptions(**{**options, "camera": cameras[0], "epoch": last.epoch}))
    frame.result()
    assert frame.statistics is not None
    assert frame.statistics.records_new == 0


def test_what_a_leased_fill_cannot_be(service: fogbank.Service, tmp_path: Path) -> None:
    scene = service.load(write_scene(tmp_path / "scene"))
    for options, leased, field in (
        (RenderOptions(integrator="radiance-cache"), False, "fill_only"),
        (RenderOptions(integrator="volpath"), True, "settings.integrator"),
        (RenderOptions(integrator="radiance-cache", time_budget=1.0), True, "settings.time_budget_seconds"),
        (RenderOptions(integrator="radiance-cache", epoch=1), True, "settings.epoch"),
    ):
        with pytest.raises(fogbank.InvalidArgumentError) as refused:
            scene.create_job(options, request_id=None, priority="normal", leased=leased, fill_only=True)
        assert refused.value.metadata["field"] == field


def test_a_cancelled_job_leaves_the_workers_free(
    service: fogbank.Service, cluster: Client, tmp_path: Path, record: Record
) -> None:
    options = RenderOptions(**{**PATHS, "spp": 4096, "tile_size": 64})
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **options)
    while not any(worker.engine and worker.engine.running for worker in farm.farm_status(cluster).workers):
        time.sleep(0.02)
    began = time.monotonic()
    job.cancel()
    while any(worker.engine and worker.engine.running for worker in farm.farm_status(cluster).workers):
        time.sleep(0.02)
    record("from the cancellation until workers are free", time.monotonic() - began, "s")
    with pytest.raises(fogbank.JobCancelledError):
        job.result()
    job.join_farm()


def test_a_worker_of_another_build_is_refused(
    service: fogbank.Service, cluster: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = Coordinator.__init__

    def other_build(self: Coordinator, *arguments: object, costs: Costs, build_id: str) -> None:
        begin(self, *arguments, costs=costs, build_id="another")  # type: ignore[arg-type]

    monkeypatch.setattr(Coordinator, "__init__", other_build)
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **PATHS)
    with pytest.raises(farm.FarmError, match="build") as refused:
        job.result()
    assert refused.value.reason == "NO_WORKERS"
    job.join_farm()


def test_status_tells_of_workers_and_jobs(service: fogbank.Service, cluster: Client, tmp_path: Path) -> None:
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **PATHS)
    job.result()
    job.join_farm()
    status = farm.farm_status(cluster)
    assert len(status.workers) == 2
    assert all(worker.engine is not None and worker.engine.threads == 1 for worker in status.workers)
    assert status.jobs[job.name]["ended"]
    assert status.jobs[job.name]["farm"]["kinds"]["tile"]["tasks"] == job.farm.kinds["tile"].tasks


def test_a_scene_without_its_files_is_refused(service: fogbank.Service, cluster: Client, tmp_path: Path) -> None:
    name = service.load(write_scene(tmp_path / "scene")).name
    with pytest.raises(farm.FarmError, match=r"Service\.load"):
        farm.render(service.scene(name), cluster, **PATHS)


@pytest.mark.usefixtures("trips_as_measured")
def test_the_quickest_of_the_newest_trips_counts() -> None:
    trips = Trips()
    usual = trips.seconds()
    assert usual >= HANDLING_SECONDS
    for seconds in (float("nan"), -1.0, float("inf")):
        trips.learn(seconds)
    assert trips.seconds() == usual
    for seconds in (0.9, 0.07, 0.5):
        trips.learn(seconds)
    assert trips.seconds() == 0.07
    for _ in range(16):
        trips.learn(5.0)
    assert trips.seconds() < 5.0, "the server's threads are few, however far the workers are"
    trips.learn(0.0)
    assert trips.seconds() == HANDLING_SECONDS, "what the coordinator itself spends on a trip"


def test_batches_follow_what_tasks_cost() -> None:
    costs = Costs()
    assert costs.batch_size("tile", slots=4, left=1000) == 1, "nothing is known yet"
    costs.learn("tile", 10.0, 100)
    assert costs.batch_size("tile", slots=4, left=60) == int(BATCH_SECONDS / 0.1)
    assert costs.batch_size("tile", slots=4, left=16) == 2, "the end of a stage is shared out"
    costs.learn("tile", float("nan"), 3)
    assert costs.seconds("tile") == pytest.approx(0.1)
    # Whatever the number of workers, handling the batches takes no longer than performing them.
    left, batches = 4000, 0
    while left > 0:
        left -= costs.batch_size("tile", slots=1000, left=left)
        batches += 1
    assert batches * HANDLING_SECONDS < 4000 * 0.1 / batches * 6
