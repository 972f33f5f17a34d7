"""The program of a method's process: `python -m fogbank.comparison.worker KIND MEMORY_BYTES`.

Answers one JSON command a line:

    {"command": "start", ...}   see `Start`; answers {"startup_seconds", "load_seconds", "warm_up_seconds", "versions"}
    {"command": "render", ...}  see `Render`; answers the fields of `Rendered`
"""

from __future__ import annotations

import json
import os
import resource
import sys
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True)
class Start:
    """What a worker renders."""

    settings: dict[str, Any]
    """Of the method, see `methods.Method`."""

    scene: str
    """Path of the prepared XML, see `scene_text`."""

    size: tuple[int, int]
    """Width and height in pixels."""

    max_depth: int
    """Greatest path length in edges, -1 for no limit."""

    mitsuba_rr_depth: int
    """Where the scene file has Russian roulette begin."""

    threads: int
    """Threads to render with."""


@dataclass(frozen=True)
class Started:
    """What getting ready cost, in wall-clock seconds."""

    startup_seconds: float
    """Until the renderer could load a scene."""

    load_seconds: float
    """Loading of the scene."""

    warm_up_seconds: float
    """Just-in-time compilation and other work of the first picture alone."""

    versions: dict[str, str]
    """Of what renders."""


@dataclass(frozen=True)
class Render:
    """One picture, cold: nothing is reused of pictures before."""

    output: str
    """EXR file to write."""

    seed: int
    """Of the random numbers."""

    seconds: float | None = None
    """Wall-clock time to use, denoising included."""

    records: int | None = None
    """Records to make, with a fixed number of samples; for methods with a cache."""

    spp: int | None = None
    """Samples per pixel, with `records`."""

    cache_picture: str = ""
    """PNG file for the records seen from above."""


@dataclass(frozen=True)
class Rendered:
    """What a picture took."""

    wall_seconds: float
    """Rendering and denoising, without start-up, loading, compilation and writing of the file."""

    cpu_seconds: float
    """The same of all threads."""

    denoise_seconds: float = 0.0
    """Share of `wall_seconds`."""

    warm_up_seconds: float = 0.0
    """Compilation that this picture caused; not part of `wall_seconds`."""

    samples_per_pixel: int | None = None
    """Or the quality of a command."""

    rays: int | None = None
    """Rays traced; None where the method doesn't say."""

    records: int | None = None
    """Records made; None without a cache."""

    peak_bytes: int | None = None
    """Greatest resident memory of the renderer's process so far."""

    note: str = ""
    """What else is to be known."""

    more: dict[str, Any] = field(default_factory=dict)
    """Figures of this method alone."""


class Worker(Protocol):
    """What renders."""

    def start(self, start: Start) -> Started:
        """Gets ready."""
        ...

    def render(self, render: Render) -> Rendered:
        """Makes one picture."""
        ...


def own_peak_bytes() -> int:
    """Greatest resident memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _make(kind: str) -> Worker:
    if kind == "fogbank":
        from fogbank.comparison.fogbank_worker import FogbankWorker

        return FogbankWorker()
    if kind == "mitsuba":
        from fogbank.comparison.mitsuba_worker import MitsubaWorker

        return MitsubaWorker()
    from fogbank.comparison.command_worker import CommandWorker

    return CommandWorker()


def main() -> None:
    """Answers commands until standard input ends."""
    kind, memory_bytes = sys.argv[1:]
    # Private memory rather than address space, of which allocators and Embree reserve much more than they use.
    resource.setrlimit(resource.RLIMIT_DATA, (int(memory_bytes), int(memory_bytes)))
    # Whatever a renderer prints must not get between the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    worker: Worker | None = None
    for line in sys.stdin:
        arguments = json.loads(line)
        try:
            if arguments.pop("command") == "start":
                worker = _make(kind)
                answer = asdict(worker.start(Start(**arguments)))
            else:
                assert worker is not None
                answer = asdict(worker.render(Render(**arguments)))
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
