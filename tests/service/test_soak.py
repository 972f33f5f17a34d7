"""Hours of work in one server: many clients that come, go, cancel and make mistakes (`make soak`).

`FOGBANK_SOAK_SECONDS` sets how long (default 600). Every image that a client gets is compared bit for bit with the one
of the same settings from a quiet server, so a race that touches a pixel is seen; in the end nothing may be left behind.
"""

from __future__ import annotations

import os
import random
import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import fogbank
import numpy as np
import psutil
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENES = ("scenes/penumbra/penumbra.xml", "scenes/analytic/furnace_medium.xml")
SECONDS = float(os.environ.get("FOGBANK_SOAK_SECONDS", "600"))
CLIENTS = 6
SEEDS = 4
FILM = fogbank.Window(0, 0, 48, 48)

# What an allocator may keep: arenas of a worker thread each, and fragmentation. A leak of one film (48 x 48 pixels of
# 48 bytes) a job passes this after 1200 jobs.
MEMORY_SLACK_BYTES = 128 << 20
# Sockets of clients that have just gone, and database files that are opened when they are first needed.
FILE_SLACK = 32


@dataclass(frozen=True)
class Work:
    """A render that clients ask for again and again."""

    scene: str
    options: fogbank.RenderOptions

    def render(self, service: fogbank.Service) -> fogbank.Job:
        """Starts it."""
        return service.load(ROOT / self.scene).render(**self.options)


def catalogue() -> list[Work]:
    """All renders that occur."""
    return [
        Work(
            scene,
            {
                "size": (FILM.width, FILM.height),
                "spp": 4 + 12 * (seed % 2),
                "seed": seed,
                "tile_size": 16 << (seed % 2),
            },
        )
        for scene in SCENES
        for seed in range(SEEDS)
    ]


class Client(threading.Thread):
    """One client after another, each with a connection of its own, until the deadline."""

    def __init__(self, number: int, address: str, expected: Mapping[int, fogbank.Image], deadline: float) -> None:
        """`expected`: the pixels of each entry of the catalogue."""
        super().__init__(name=f"client {number}")
        self._random = random.Random(number)
        self._address = address
        self._expected = expected
        self._deadline = deadline
        self.done: Counter[str] = Counter()
        self.failure: BaseException | None = None

    def run(self) -> None:
        """Acts until the deadline or the first failure."""
        actions = (self.render, self.watch, self.watch_again_and_again, self.cancel, self.leave, self.blunder)
        try:
            while time.monotonic() < self._deadline:
                with fogbank.connect(self._address) as service:
                    for _ in range(self._random.randint(1, 8)):
                        action = self._random.choice(actions)
                        action(service)
                        self.done[action.__name__] += 1
        except BaseException as error:
            self.failure = error

    def _pick(self) -> tuple[int, Work]:
        works = catalogue()
        index = self._random.randrange(len(works))
        return index, works[index]

    def render(self, service: fogbank.Service) -> None:
        """Renders and fetches the file."""
        index, work = self._pick()
        assert np.array_equal(work.render(service).result(), self._expected[index])

    def watch(self, service: fogbank.Service) -> None:
        """Puts the image together from its tiles."""
        index, work = self._pick()
        image = np.zeros_like(self._expected[index])
        for tile in work.render(service).tiles(update_interval=0.0):
            fogbank.place(image, FILM, tile)
        assert np.array_equal(image, self._expected[index])

    def watch_again_and_again(self, service: fogbank.Service) -> None:
        """Drops the stream after a few events, several times, and has the whole image in the end."""
        index, work = self._pick()
        job = work.render(service)
        image = np.zeros_like(self._expected[index])
        for _ in range(self._random.randint(1, 5)):
            events = job.events(update_interval=0.0)
            for _, event in zip(range(self._random.randint(1, 6)), events, strict=False):
                if isinstance(event, fogbank.Tile):
                    fogbank.place(image, FILM, event)
            events.close()  # type: ignore[attr-defined]
        for tile in job.tiles():
            fogbank.place(image, FILM, tile)
        assert np.array_equal(image, self._expected[index])

    def cancel(self, service: fogbank.Service) -> None:
        """Cancels somewhere in the middle; a job that was quicker has its image."""
        index, work = self._pick()
        job = work.render(service)
        time.sleep(self._random.uniform(0.0, 0.05))
        job.cancel()
        if job.wait().state is fogbank.JobState.SUCCEEDED:
            assert np.array_equal(job.result(), self._expected[index])
        else:
            assert job.state is fogbank.JobState.CANCELLED

    def leave(self, service: fogbank.Service) -> None:
        """Starts a job and never asks for it again."""
        self._pick()[1].render(service)

    def blunder(self, service: fogbank.Service) -> None:
        """Asks for what cannot be had."""
        with pytest.raises(fogbank.NotFoundError):
            service.scene("scenes/" + "0" * 64)
        with pytest.raises(fogbank.InvalidArgumentError):
            service.load(ROOT / SCENES[0]).render(spp=1, size=(1, 1 << 20))


@pytest.mark.soak
@pytest.mark.timeout(0)
def test_a_busy_server_stays_right_and_leaves_nothing_behind(tmp_path: Path) -> None:
    with fogbank.connect(data=tmp_path / "quiet", threads=1) as quiet:
        expected = {i: work.render(quiet).result() for i, work in enumerate(catalogue())}

    with fogbank.connect(data=tmp_path / "busy", threads=2) as busy:
        process = server_process()
        # Everything has been used once before anything is measured.
        for i, work in enumerate(catalogue()):
            assert np.array_equal(work.render(busy).result(), expected[i])
        memory = process.memory_info().rss
        files = process.num_fds()

        deadline = time.monotonic() + SECONDS
        clients = [Client(number, busy.address, expected, deadline) for number in range(CLIENTS)]
        for client in clients:
            client.start()
        for client in clients:
            client.join()
        for client in clients:
            if client.failure is not None:
                raise client.failure

        for job in busy.jobs():
            assert job.wait().ended
        done = sum((client.done for client in clients), Counter[str]())
        growth = process.memory_info().rss - memory
        print(f"{done.total()} actions {dict(done)}, memory grew by {growth / 2**20:.1f} MiB")
        assert growth < MEMORY_SLACK_BYTES
        assert process.num_fds() < files + FILE_SLACK
        assert np.array_equal(catalogue()[0].render(busy).result(), expected[0])


def server_process() -> psutil.Process:
    """The embedded server: the only child of this program."""
    (child,) = psutil.Process().children()
    return child
