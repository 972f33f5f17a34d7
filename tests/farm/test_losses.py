"""Workers that are killed, slow, late or wrong: the picture stays what one machine makes of it."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import fogbank
import pytest
from distributed import Client, Worker
from fogbank import RenderOptions, farm
from fogbank._generated.v1 import farm_pb2
from fogbank.channel import Connection
from fogbank.farm import coordinator
from fogbank.farm.coordination import TaskNumber, hand_in

from tests.farm.conftest import Record
from tests.farm.scenes import PATHS, RECORDS, assert_same_pictures, write_scene

pytestmark = pytest.mark.farm

# 200 tiles.
TILES = RenderOptions(**{**PATHS, "size": (320, 160), "spp": 12})
ROUNDS = RenderOptions(**{**RECORDS, "size": (96, 64), "error": 0.1, "spp": 32})

KILL_SECONDS = 2.0


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Callable[[RenderOptions], fogbank.Image]:
    """Pictures by a server without a farm and with an empty cache, each made once."""
    known: dict[str, fogbank.Image] = {}

    def picture(options: RenderOptions) -> fogbank.Image:
        key = repr(sorted(options.items()))
        if key not in known:
            folder = tmp_path_factory.mktemp("alone")
            with fogbank.connect(data=folder / "data", threads=2) as service:
                known[key] = service.load(write_scene(folder / "scene")).render(**options).result()
        return known[key]

    return picture


@pytest.fixture(params=[TILES, ROUNDS], ids=["tiles", "records"])
def options(request: pytest.FixtureRequest) -> RenderOptions:
    """What to render."""
    chosen: RenderOptions = request.param
    return chosen


Expected = Callable[[RenderOptions], fogbank.Image]


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_any_number_of_workers(
    service: fogbank.Service, tmp_path: Path, expected: Expected, options: RenderOptions, workers: int
) -> None:
    with farm.local_cluster(workers) as client:
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **options)
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(options))


def test_a_worker_killed_every_two_seconds(
    service: fogbank.Service, tmp_path: Path, expected: Expected, options: RenderOptions, record: Record
) -> None:
    with farm.local_cluster(4) as client:
        done = threading.Event()
        killed: list[int] = []
        killer = threading.Thread(target=kill_workers, args=(client, done, killed))
        killer.start()
        try:
            job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **options)
            image = job.result()
        finally:
            done.set()
            killer.join()
        job.join_farm()
    assert_same_pictures(image, expected(options))
    record("workers killed", len(killed), "")
    record("batches", job.farm.batches, "")
    record("batches that Dask gave up and were repeated", job.farm.lost, "")


def kill_workers(client: Client, done: threading.Event, killed: list[int]) -> None:
    """Kills one worker, engine and all, every two seconds, as long as another one is there."""
    dice = random.Random(7)
    while not done.wait(KILL_SECONDS):
        processes = client.run(lambda: os.getpid(), on_error="ignore")
        if len(processes) > 1:
            process = dice.choice(sorted(processes.values()))
            os.kill(process, signal.SIGKILL)
            killed.append(process)


def test_results_that_come_twice_and_late(
    service: fogbank.Service,
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
    with farm.local_cluster(2) as client:
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **options)
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(options))
    assert job.farm.ignored > 0
    record("results ignored", job.farm.ignored, "")


def poison(dask_worker: Worker) -> str:
    """Makes a worker hand in what is not a number, and results of a wrong size."""
    from fogbank.farm.engine import Engine

    perform = Engine._perform

    def poisoned(self: Engine, *arguments: object) -> Iterator[bytes]:
        for number, data in enumerate(perform(self, *arguments)):  # type: ignore[arg-type]
            part = farm_pb2.TaskResultPart.FromString(data)
            part.data = part.data[:-3] if number % 2 else b"\xff" * len(part.data)
            yield part.SerializeToString()

    Engine._perform = poisoned  # type: ignore[assignment, method-assign]
    return str(dask_worker.address)


def test_a_worker_that_poisons_results_is_set_aside(
    service: fogbank.Service, tmp_path: Path, expected: Expected, options: RenderOptions, record: Record
) -> None:
    with farm.local_cluster(2) as client:
        wrong = next(iter(client.nthreads()))
        client.run(poison, workers=[wrong])
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **options)
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(options))
    assert job.farm.workers[wrong].set_aside
    assert job.farm.workers[wrong].poisoned >= 3
    record("poisoned results refused", job.farm.poisoned, "")


def delay(seconds: float) -> None:
    """Makes a worker slow."""
    from fogbank.farm.engine import Engine

    perform = Engine._perform

    def slow(self: Engine, *arguments: object) -> Iterator[bytes]:
        time.sleep(seconds)
        yield from perform(self, *arguments)  # type: ignore[arg-type]

    Engine._perform = slow  # type: ignore[assignment, method-assign]


def test_stragglers_are_given_to_others(
    service: fogbank.Service, tmp_path: Path, expected: Expected, record: Record
) -> None:
    with farm.local_cluster(2) as client:
        client.run(delay, 10.0, workers=[next(iter(client.nthreads()))])
        began = time.monotonic()
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **PATHS)
        image = job.result()
        record("with one worker that waits 10 s before each batch", time.monotonic() - began, "s")
        job.join_farm()
    assert_same_pictures(image, expected(PATHS))
    assert job.farm.stragglers > 0
    record("stragglers given to another worker", job.farm.stragglers, "")
