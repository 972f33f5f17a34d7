"""A comparison from request to report."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

import fogbank
from fogbank.comparison import analysis, machine, scene_text
from fogbank.comparison.image_error import Pixels, read
from fogbank.comparison.methods import Method, default_methods, parse_methods
from fogbank.comparison.references import Reference, ReferenceState, load_reference, make_reference
from fogbank.comparison.report import Report, write_report
from fogbank.comparison.runner import Clock, ComparisonProgress, Runner, planned_seconds
from fogbank.comparison.runs import Run, RunStore, plan
from fogbank.comparison.worker import Start
from fogbank.errors import InvalidArgumentError
from fogbank.window import Window

_REFERENCE_BUDGETS = 20.0
_LEAST_REFERENCE_SECONDS = 60.0
_MEMORY_SHARE = 0.8


@dataclass(frozen=True)
class Request:
    """The arguments of `compare`, which documents them."""

    scene: str
    output: str
    methods: tuple[str, ...] | None
    budgets: tuple[float, ...]
    seeds: int
    equal: Literal["time", "records"]
    spp: int | None
    reference: str | None
    make_reference: float | None
    size: tuple[int | None, int | None] | None
    max_depth: int | None
    parameters: dict[str, str]
    adapters: dict[str, str]
    insets: tuple[Window, ...] | None
    threads: int | None
    memory_bytes: int | None
    command: str | None

    def check(self) -> None:
        """InvalidArgumentError, naming the argument."""
        if not self.budgets or not all(0.0 < budget < 1e9 for budget in self.budgets):
            raise _invalid("budgets", "are to be positive numbers")
        if self.equal == "records" and any(budget != int(budget) for budget in self.budgets):
            raise _invalid("budgets", "are to be whole numbers of records")
        if self.seeds < 1:
            raise _invalid("seeds", "is to be 1 at least")
        if self.equal not in ("time", "records"):
            raise _invalid("equal", f"{self.equal!r} is none of time, records")
        if self.reference is not None and self.make_reference is not None:
            raise _invalid("reference", "is given and is to be made; choose one")


class Images(Mapping[tuple[str, float, int], Pixels]):
    """Pictures by (method, budget, seed), read from the disk when asked for; linear Rec. 709, (height, width, 3)."""

    def __init__(self, paths: Mapping[tuple[str, float, int], Path]) -> None:
        """`paths` are EXR files."""
        self.paths = dict(paths)

    def __getitem__(self, key: tuple[str, float, int]) -> Pixels:
        """A picture."""
        return read(self.paths[key])

    def __iter__(self) -> Iterator[tuple[str, float, int]]:
        """Keys."""
        return iter(self.paths)

    def __len__(self) -> int:
        """Number of pictures."""
        return len(self.paths)


@dataclass(frozen=True)
class Comparison:
    """What a comparison found."""

    folder: Path
    """Where everything lies."""

    report: Path
    """report.html."""

    table: pd.DataFrame
    """A row for each picture that was planned; columns: `analysis.COLUMNS`."""

    summary: pd.DataFrame
    """A row for each method and budget: means over the seeds."""

    time_to_error: pd.DataFrame
    """CPU seconds to each level of error, see `analysis.cost_to_error`."""

    records_to_error: pd.DataFrame
    """The same in records; of methods that make none nothing is known."""

    images: Images
    """The pictures."""

    reference: Reference
    """What they are measured against."""


def run_comparison(request: Request, on_progress: Callable[[ComparisonProgress], None] | None) -> Comparison:
    """See `compare`."""
    request.check()
    folder = Path(request.output)
    store = RunStore(folder)
    path, size = _prepare(request, folder)
    threads = request.threads or os.cpu_count() or 1
    with (
        tempfile.TemporaryDirectory(prefix="fogbank-comparison-") as data,
        fogbank.connect(data=data, threads=threads) as service,
    ):
        scene = service.load(path)
        capabilities = service.capabilities
        names = request.methods or default_methods(list(capabilities.integrators))
        methods = parse_methods(
            names, list(capabilities.integrators), capabilities.cached_integrators, request.adapters
        )
        max_depth = scene.defaults.max_depth if request.max_depth is None else request.max_depth
        settings = {
            "scene": scene.name,
            "size": list(size),
            "max_depth": max_depth,
            "equal": request.equal,
            "spp": request.spp,
            "threads": threads,
            # Pictures of another build are not to stand beside those of this one.
            "build": capabilities.build_id,
        }
        store.check_settings(settings)
        planned = plan(methods, request.budgets, request.seeds, by_records=request.equal == "records")
        reference_seconds = _reference_seconds(request)
        clock = Clock(1.0, on_progress)
        clock.planned += _planned_seconds(planned, store, methods, request) + reference_seconds
        reference = _reference(request, folder, scene, size, max_depth, threads, clock)
    versions = {"fogbank": f"{capabilities.version} ({capabilities.build_id[:12]})"}
    runner = Runner(
        store=store,
        reference=reference,
        methods=methods,
        start=Start(
            settings={},
            scene=str(path.resolve()),
            size=size,
            max_depth=max_depth,
            mitsuba_rr_depth=scene_text.mitsuba_rr_depth(path.read_text(encoding="utf-8")),
            threads=threads,
        ),
        memory_bytes=request.memory_bytes or int(_MEMORY_SHARE * machine.memory_bytes()),
        by_records=request.equal == "records",
        spp=request.spp,
    )
    runs = runner.run_all(planned, clock)
    clock.tell("writing the report")
    return _finish(request, store, methods, runs, reference, versions, settings)


def _invalid(field: str, what: str) -> InvalidArgumentError:
    return InvalidArgumentError(f"{field}: {what}", metadata={"field": field})


def _prepare(request: Request, folder: Path) -> tuple[Path, tuple[int, int]]:
    """The scene as all methods get it, and its size."""
    original, wanted = Path(request.scene), request.size
    if wanted is None and request.reference is not None:
        height, width = load_reference(Path(request.reference)).half_a.shape[:2]
        wanted = width, height
    size = scene_text.choose_size(original, request.parameters, wanted)
    return scene_text.prepare_scene(original, folder / "scene", size, request.parameters), size


def _reference_seconds(request: Request) -> float:
    if request.reference is not None:
        return 0.0
    if request.make_reference is not None:
        return request.make_reference
    if request.equal == "records":
        return _LEAST_REFERENCE_SECONDS
    return max(_REFERENCE_BUDGETS * max(request.budgets), _LEAST_REFERENCE_SECONDS)


def _planned_seconds(runs: list[Run], store: RunStore, methods: list[Method], request: Request) -> float:
    by_name = {method.name: method for method in methods}
    missing = [run for run in runs if run.status == "not tried" and store.load(run, by_name[run.method]) is run]
    return sum(planned_seconds(run, by_records=request.equal == "records") for run in missing)


def _reference(
    request: Request,
    folder: Path,
    scene: fogbank.Scene,
    size: tuple[int, int],
    max_depth: int,
    threads: int,
    clock: Clock,
) -> Reference:
    """Read or made."""
    if request.reference is not None:
        reference = load_reference(Path(request.reference))
        if reference.half_a.shape[:2] != (size[1], size[0]):
            height, width = reference.half_a.shape[:2]
            raise _invalid("reference", f"is {width}x{height}, the pictures are {size[0]}x{size[1]}")
        return reference
    seconds = _reference_seconds(request)

    def tell(state: ReferenceState) -> None:
        clock.done = min(state.seconds, seconds)
        clock.tell(f"reference, residual error {100.0 * (state.residual or 0.0):.2g} %")

    clock.tell("reference")
    path = folder / "reference.exr"
    make_reference(scene, path, seconds=seconds, size=size, max_depth=max_depth, threads=threads, on_progress=tell)
    clock.done = seconds
    return load_reference(path)


def _finish(
    request: Request,
    store: RunStore,
    methods: list[Method],
    runs: list[Run],
    reference: Reference,
    versions: dict[str, str],
    settings: dict[str, Any],
) -> Comparison:
    """Tables, report."""
    by_name = {method.name: method for method in methods}
    paths = {
        (run.method, run.budget, run.seed): store.image_path(run, by_name[run.method])
        for run in runs
        if run.status == "done"
    }
    for run in runs:
        versions |= run.figures.get("versions", {})
    results = analysis.table(runs)
    results.to_csv(store.folder / "results.csv", index=False)
    means = analysis.summary(results)
    names = [method.name for method in methods]
    base = analysis.choose_base(names)
    by_records = request.equal == "records"
    kinds: tuple[analysis.Cost, ...] = ("cpu_seconds", "wall_seconds", "records")
    costs = {kind: analysis.cost_to_error(means, names, base, kind) for kind in kinds}
    report = Report(
        folder=store.folder,
        scene=Path(request.scene).stem,
        methods=names,
        base=base,
        by_records=by_records,
        results=results,
        means=means,
        costs=costs,
        split=analysis.bias_and_variance(paths, reference),
        images=paths,
        reference=reference,
        insets=request.insets,
        facts=machine.describe() | {f"version of {name}": text for name, text in versions.items()},
        settings=settings | {"seeds": request.seeds, "budgets": list(request.budgets)},
        command=request.command or "",
    )
    return Comparison(
        folder=store.folder,
        report=write_report(report),
        table=results,
        summary=means,
        time_to_error=costs["cpu_seconds"],
        records_to_error=costs["records"],
        images=Images(paths),
        reference=reference,
    )
