"""Workers that are killed, slow, late or wrong: the picture stays what one machine makes of it."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import fogbank
import pytest
from distributed import Client, LocalCluster, Worker
from fogbank import RenderOptions, farm
from fogbank._generated.v1 import farm_pb2
from fogbank.channel import Connection
from fogbank.farm import coordinator
from fogbank.farm.coordination import TaskNumber, hand_in
from fogbank.farm.engine import Engine
from fogbank.farm.plugin import NAME, FarmPlugin

from tests.farm.conftest import Expected, Record
from tests.farm.scenes import PATHS, RECORDS, TILES, assert_same_pictures, write_scene

pytestmark = pytest.mark.farm

ROUNDS = RenderOptions(**{**RECORDS, "size": (96, 64), "error": 0.1, "spp": 32})

KILL_SECONDS = 2.0

# 200 tiles, and rounds of records, that take long enough for several kills.
MANY_SAMPLES = RenderOptions(**{**TILES, "spp": 64})
MANY_RECORDS = RenderOptions(**{**ROUNDS, "error": 0.05, "spp": 384})


@pytest.fixture(scope="module", params=[1, 2, 4], ids=["1-worker", "2-workers", "4-workers"])
def cluster(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Workers of one thread; the tests that ask for the same number share them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("workers")))
        with farm.local_cluster(request.param) as client:
            yield client


def workers(number: int) -> pytest.MarkDecorator:
    """Asks for a cluster of so many workers."""
    return pytest.mark.parametrize("cluster", [number], indirect=True, ids=[f"{number}-workers"])


@pytest.fixture(params=[TILES, ROUNDS], ids=["tiles", "records"])
def options(request: pytest.FixtureRequest) -> RenderOptions:
    """What to render."""
    chosen: RenderOptions = request.param
    return chosen


def test_any_number_of_workers(
    service: fogbank.Service, cluster: Client, tmp_path: Path, expected: Expected, options: RenderOptions
) -> None:
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **options)
    image = job.result()
    job.join_farm()
    assert_same_pictures(image, expected(options).image)


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Client]:
    """Four workers that are processes, each looked after by another one."""
    with (
        LocalCluster(
            n_workers=4,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            local_directory=str(tmp_path / "workers"),
            silence_logs=50,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.mark.parametrize("options", [MANY_SAMPLES, MANY_RECORDS], ids=["tiles", "records"])
def test_a_worker_killed_every_two_seconds(
    service: fogbank.Service,
    processes: Client,
    tmp_path: Path,
    expected: Expected,
    options: RenderOptions,
    record: Record,
) -> None:
    done = threading.Event()
    killed: list[int] = []
    killer = threading.Thread(target=kill_workers, args=(processes, done, killed))
    killer.start()
    try:
        job = farm.render(service.load(write_scene(tmp_path / "scene")), processes, **options)
        image = job.result()
    finally:
        done.set()
        killer.join()
    job.join_farm()
    assert_same_pictures(image, expected(options).image)
    assert len(killed) > 1
    record("workers killed", len(killed), "")
    record("batches", job.farm.batches, "")
    record("batches that Dask gave up and were repeated", job.farm.lost, "")
    processes.wait_for_workers(4)


def kill_workers(client: Client, done: threading.Event, killed: list[int]) -> None:
    """Kills one worker, engine and all, every two seconds."""
    dice = random.Random(7)
    while not done.wait(KILL_SECONDS):
        if processes := client.run(lambda: os.getpid(), on_error="ignore"):
            process = dice.choice(sorted(processes.values()))
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
                killed.append(process)


@workers(2)
def test_results_that_come_twice_and_late(
    service: fogbank.Service,
    cluster: Client,
    tmp_path: Path,
    expected: Expected,
    options: RenderOptions,
    monkeypatch: pytest.MonkeyPatch,
    record: Record,
) -> None:
    dice = random.Random(11)
    held: list[tuple[str, list[farm_pb2.TaskResultPart]]] = []
    seen = 0

    def unreliable(
        connection: Connection, job: str, log: str, parts: Sequence[farm_pb2.TaskResultPart]
    ) -> tuple[int, dict[TaskNumber, str]]:
        nonlocal seen
        time.sleep(dice.choice([0.0, 0.0, 0.2]))
        ignored, refused = hand_in(connection, job, log, parts)
        held.append((log, list(parts)))
        # Once more at once, and some of long ago.
        for other, again in [held[-1], dice.choice(held)]:
            ignored += hand_in(connection, job, other, again)[0]
        seen = max(seen, ignored)
        return ignored, refused

    monkeypatch.setattr(coordinator, "hand_in", unreliable)
    job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **options)
    image = job.result()
    job.join_farm()
    assert_same_pictures(image, expected(options).image)
    assert job.farm.ignored > 0
    record("results ignored", job.farm.ignored, "")


def poison(dask_worker: Worker) -> None:
    """Makes a worker hand in what is not a number, and results of a wrong size."""
    engine = engine_of(dask_worker)
    perform = engine._perform

    def poisoned(*arguments: object) -> Iterator[bytes]:
        for number, data in enumerate(perform(*arguments)):  # type: ignore[arg-type]
            part = farm_pb2.TaskResultPart.FromString(data)
            part.data = part.data[:-3] if number % 2 else b"\xff" * len(part.data)
            yield part.SerializeToString()

    engine._perform = poisoned  # type: ignore[assignment, method-assign]


def delay(dask_worker: Worker) -> None:
    """Makes a worker wait before each batch, until it is mended."""
    engine = engine_of(dask_worker)
    perform = engine._perform
    engine.mended = threading.Event()  # type: ignore[attr-defined]

    def slow(*arguments: object) -> Iterator[bytes]:
        engine.mended.wait()  # type: ignore[attr-defined]
        yield from perform(*arguments)  # type: ignore[arg-type]

    engine._perform = slow  # type: ignore[assignment, method-assign]


def mend(dask_worker: Worker) -> None:
    """Makes a worker as the others are."""
    engine = engine_of(dask_worker)
    vars(engine).pop("_perform")
    if (waiting := vars(engine).pop("mended", None)) is not None:
        waiting.set()


def engine_of(dask_worker: Worker) -> Engine:
    """What performs a worker's batches."""
    plugin = dask_worker.plugins[NAME]
    assert isinstance(plugin, FarmPlugin)
    assert plugin.engine is not None
    return plugin.engine


@contextlib.contextmanager
def one_worker(cluster: Client, change: Callable[[Worker], None]) -> Iterator[str]:
    """Changes a worker; its address."""
    cluster.register_plugin(FarmPlugin())
    address = min(cluster.nthreads())
    cluster.run(change, workers=[address])
    try:
        yield address
    finally:
        cluster.run(mend, workers=[address])


@workers(2)
def test_a_worker_that_poisons_results_is_set_aside(
    service: fogbank.Service,
    cluster: Client,
    tmp_path: Path,
    expected: Expected,
    options: RenderOptions,
    record: Record,
) -> None:
    with one_worker(cluster, poison) as wrong:
        job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **options)
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(options).image)
    assert job.farm.workers[wrong].set_aside
    assert job.farm.workers[wrong].poisoned >= 3
    record("poisoned results refused", job.farm.poisoned, "")


@workers(2)
def test_stragglers_are_given_to_others(
    service: fogbank.Service, cluster: Client, tmp_path: Path, expected: Expected, record: Record
) -> None:
    with one_worker(cluster, delay):
        began = time.monotonic()
        job = farm.render(service.load(write_scene(tmp_path / "scene")), cluster, **PATHS)
        image = job.result()
        record("with one worker that never returns", time.monotonic() - began, "s")
        job.join_farm()
    assert_same_pictures(image, expected(PATHS).image)
    assert job.farm.stragglers > 0
    record("stragglers given to another worker", job.farm.stragglers, "")
