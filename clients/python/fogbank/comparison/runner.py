"""Makes the pictures of a comparison that aren't there yet, each method in a process of its own."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from fogbank.comparison.engine import Engine, EngineError
from fogbank.comparison.image_error import flip, measure, read
from fogbank.comparison.methods import Method
from fogbank.comparison.references import Reference
from fogbank.comparison.runs import Run, RunStore
from fogbank.comparison.worker import Render, Start

_START_SECONDS = 600.0
"""For loading and compilation; a method that isn't ready then is ended."""
_PATIENCE = 10.0
"""Times the budget, and a minute more, after which a method is ended."""
_MOST_FAILURES = 2
"""Of a method; after that the others are spared the wait."""
_OVERHEAD_SECONDS = 1.0
"""Of a picture besides its budget, for the time left."""


@dataclass(frozen=True)
class ComparisonProgress:
    """How far a comparison is."""

    doing: str
    """What is being done, for people."""

    fraction: float
    """Share of the work of this session that is done, 0 to 1."""

    eta_seconds: float | None
    """Estimated seconds left; None while unknown."""


Sink: TypeAlias = Callable[[ComparisonProgress], None]


@dataclass
class Clock:
    """Estimates the time left from planned seconds."""

    planned: float
    """Seconds that everything would take if nothing took longer than it should; > 0."""

    sink: Sink | None
    """Is told."""

    done: float = 0.0
    """Of `planned`."""

    def __post_init__(self) -> None:
        """Begins now."""
        self._begin = time.monotonic()

    def tell(self, doing: str) -> None:
        """Reports."""
        if self.sink is None:
            return
        fraction = min(self.done / self.planned, 1.0)
        elapsed = time.monotonic() - self._begin
        eta = elapsed * (1.0 - fraction) / fraction if fraction > 0.0 else self.planned
        self.sink(ComparisonProgress(doing, fraction, eta))


def planned_seconds(run: Run, *, by_records: bool) -> float:
    """What a picture should take; of records nothing is known, and all weigh the same."""
    return _OVERHEAD_SECONDS + (0.0 if by_records else run.budget)


@dataclass
class Runner:
    """Runs the methods."""

    store: RunStore
    reference: Reference
    methods: Sequence[Method]
    start: Start
    """With the settings of no method."""
    memory_bytes: int
    by_records: bool
    spp: int | None

    def __post_init__(self) -> None:
        """Nothing runs yet."""
        self._by_name = {method.name: method for method in self.methods}
        self._reference_sha256 = self.reference.sha256
        self._engines: dict[str, Engine] = {}
        self._started: dict[str, dict[str, Any]] = {}
        self._failures: dict[str, int] = {}

    def run_all(self, runs: Sequence[Run], clock: Clock) -> list[Run]:
        """All runs, made or read from the disk, with their errors."""
        results = []
        with contextlib.ExitStack() as stack:
            stack.callback(self._stop)
            for run in runs:
                results.append(self._result(run, clock))
        return results

    def _method(self, run: Run) -> Method:
        return self._by_name[run.method]

    def _result(self, run: Run, clock: Clock) -> Run:
        if run.status != "not tried":
            return run
        method = self._method(run)
        found = self.store.load(run, method)
        if found is run:
            unit = "records" if self.by_records else "s"
            clock.tell(f"{run.method}, {run.budget:g} {unit}, seed {run.seed}")
            found = self._render(run, method)
            clock.done += planned_seconds(run, by_records=self.by_records)
        if found.status == "done" and found.reference != self._reference_sha256:
            found = self._measured(found, method)
            self.store.save(found, method)
        return found

    def _render(self, run: Run, method: Method) -> Run:
        if self._failures.get(method.name, 0) >= _MOST_FAILURES:
            return replace(run, message=f"not tried after {_MOST_FAILURES} failures")
        output = self.store.image_path(run, method)
        output.unlink(missing_ok=True)
        unfinished = output.with_name(f".{output.name}")
        render = Render(
            output=str(unfinished.with_suffix(".unfinished.exr")),
            seed=run.seed,
            seconds=None if self.by_records else run.budget,
            records=round(run.budget) if self.by_records else None,
            spp=self.spp if self.by_records else None,
            cache_picture=str(output.with_suffix(".cache.png")) if method.cached and run.seed == 1 else "",
        )
        seconds = 600.0 if self.by_records else 60.0 + _PATIENCE * run.budget
        try:
            figures = self._engine(method).ask("render", seconds, **asdict(render))
        except EngineError as error:
            # What is left of it can't be trusted.
            self._engines.pop(method.name).stop()
            self._failures[method.name] = self._failures.get(method.name, 0) + 1
            return replace(run, status=error.kind, message=str(error))
        Path(render.output).replace(output)
        started = self._started[method.name]
        figures["warm_up_seconds"] += started["warm_up_seconds"]
        return replace(run, status="done", message=figures.pop("note"), figures=started | figures)

    def _engine(self, method: Method) -> Engine:
        engine = self._engines.get(method.name)
        if engine is None:
            self._engines[method.name] = engine = Engine(method.kind, self.memory_bytes)
            start = replace(self.start, settings=method.settings)
            self._started[method.name] = engine.ask("start", _START_SECONDS, **asdict(start))
        return engine

    def _measured(self, run: Run, method: Method) -> Run:
        image = read(self.store.image_path(run, method))
        error = measure(image, self.reference.half_a, self.reference.half_b)
        _, mean_flip = flip(image, self.reference.mean)
        return replace(run, errors=asdict(error) | {"flip": mean_flip}, reference=self._reference_sha256)

    def _stop(self) -> None:
        for engine in self._engines.values():
            engine.stop()
        self._engines.clear()
