"""Regression watch: figures that depend little on the machine, their history, and whether the newest are worse.

Short runs of three scenes at 64 x 64 pixels. The history (tests/bench/history.json) is committed; every run adds an
entry with its commit, or replaces that of the same commit. The newest is held against the median of the entries before,
up to five.

* `cost against mitsuba`: noise x CPU seconds of `volpath` by that of Mitsuba's scalar_rgb (tests/bench/comparison.py).
* `cache against volpath`: error x CPU seconds of `radiance-cache` by that of `volpath`, with the same reference.
* `records`, `rays of the cache`: of a picture with a given error; the same to the last digit for the same code.
* `rays a sample`: of `volpath`; the same to the last digit for the same code.
* `40 records: instructions`: of 40 more records of record_bench, by callgrind; start-up and loading are taken off.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import statistics
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fogbank.comparison import image_error
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing

from tests.bench import comparison, engines, pictures
from tests.bench.comparison import Case

HISTORY = Path(__file__).with_name("history.json")
TREND = Path(__file__).with_name("history.png")
SIDE = 64
SCENES = ("shafts", "stairs", "glow")
SAMPLES = 4
ROUNDS = 6
CACHE_ERROR = 0.1
CACHE_SAMPLES = 256
REMEMBERED = 5
"""Entries whose median the newest is held against."""
TIMED = 2.0
"""Worse by this factor is outside the noise of figures with CPU times: the machine's other work moves them by up
to a third even as ratios, and the few pixels' noise adds to that."""
COUNTED = 1.5
"""The same of counts: they have no noise, but better pictures may need more work."""
INSTRUCTIONS = 1.1
"""The same of instructions, of which two runs differ by less than 0.1 %."""
INSTRUCTIONS_POINTS = (1, 41)
DIRECTIONS = 256


@dataclass(frozen=True)
class Watched:
    """A figure; less is better."""

    name: str
    value: float
    tolerance: float
    """How many times worse than before is a failure."""


@dataclass(frozen=True)
class Finding:
    """A figure beside what it was."""

    name: str
    value: float
    before: float | None
    failed: bool


def cases() -> list[Case]:
    """The three scenes, small."""
    chosen = {case.name: case for case in pictures.cases() if case.name in SCENES}
    return [chosen[name].scaled(SIDE / chosen[name].width) for name in SCENES]


def measure_scene(case: Case, threads: int, note: Callable[[str], None]) -> list[Watched]:
    """Short runs of one scene; what the engine can't render is infinite."""
    compared = comparison.compare(case, SAMPLES, ROUNDS, threads)
    cost = {engine["engine"]: engine["cost"] for engine in compared["engines"]}
    half_a, half_b = (image_error.read(path) for path in pictures.references(case, threads))
    output = engines.OUTPUT / f"watch_{case.name}.exr"
    common = {
        "width": case.width,
        "height": case.height,
        "max_depth": case.max_depth,
        "seed": 1,
        "threads": threads,
        "output": str(output),
    }

    def render(**settings: Any) -> tuple[dict[str, Any], float]:  # noqa: ANN401 - JSON
        """Answer, and error x CPU seconds."""
        answer = engine.ask("render", **common, **settings)
        error = image_error.measure(image_error.read(output), half_a, half_b).trimmed
        return answer, error * answer["cpu_seconds"]

    with engines.fogbank() as engine:
        engine.ask("load", scene=str(case.path))
        traced, traced_cost = render(integrator="volpath", samples_per_pixel=16 * SAMPLES)
        try:
            cached, cached_cost = render(
                integrator="radiance-cache", samples_per_pixel=CACHE_SAMPLES, error=CACHE_ERROR
            )
        except engines.EngineError as error:
            note(f"{case.name}: radiance-cache: {error}")
            cached, cached_cost = {"records_new": math.inf, "rays": math.inf}, math.inf
    return [
        Watched(f"{case.name}: cost against mitsuba", cost["fogbank"] / cost["scalar_rgb"], TIMED),
        Watched(f"{case.name}: cache against volpath", cached_cost / traced_cost, TIMED),
        Watched(f"{case.name}: records", cached["records_new"], COUNTED),
        Watched(f"{case.name}: rays of the cache", cached["rays"], COUNTED),
        Watched(f"{case.name}: rays a sample", traced["rays"] / traced["samples"], COUNTED),
    ]


def measure_instructions() -> list[Watched]:
    """Of record_bench; nothing without valgrind."""
    if shutil.which("valgrind") is None:
        return []
    scene = engines.ROOT / "scenes" / "penumbra" / "penumbra.xml"
    counts = []
    for points in INSTRUCTIONS_POINTS:
        command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        command += [str(engines.BINARIES / "record_bench"), str(scene), str(points), str(DIRECTIONS)]
        said = subprocess.run(command, capture_output=True, text=True, cwd=engines.ROOT, check=True).stderr
        found = re.search(r"Collected : (\d+)", said)
        if found is None:
            message = f"callgrind said no number of instructions: {said[-200:]}"
            raise RuntimeError(message)
        counts.append(int(found[1]))
    return [Watched("40 records: instructions", counts[1] - counts[0], INSTRUCTIONS)]


def measure(threads: int, note: Callable[[str], None]) -> list[Watched]:
    """All figures."""
    figures: list[Watched] = []
    for case in cases():
        note(f"watch: {case.name}")
        figures += measure_scene(case, threads, note)
    note("watch: instructions")
    return figures + measure_instructions()


def judge(figures: Sequence[Watched], history: Sequence[dict[str, Any]]) -> list[Finding]:
    """Each figure against the median of the last entries that have it. The first of its kind only fails if infinite."""
    findings = []
    for figure in figures:
        values = [entry["figures"][figure.name] for entry in history if figure.name in entry["figures"]]
        before = statistics.median(values[-REMEMBERED:]) if values else None
        worse = before is not None and figure.value > figure.tolerance * before
        failed = worse or not math.isfinite(figure.value)
        findings.append(Finding(figure.name, figure.value, before, failed))
    return findings


def commit() -> str:
    """What is measured; with a plus where the working tree differs."""
    command = ["git", "describe", "--always", "--dirty=+", "--abbrev=10", "--exclude=*"]
    return subprocess.run(command, capture_output=True, text=True, cwd=engines.ROOT, check=True).stdout.strip()


def append(history: list[dict[str, Any]], name: str, figures: Sequence[Watched]) -> list[dict[str, Any]]:
    """With the newest entry, in the place of one of the same commit."""
    entry = {
        "commit": name,
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "figures": {figure.name: figure.value for figure in figures if math.isfinite(figure.value)},
    }
    return [*(old for old in history if old["commit"] != name), entry]


def draw(history: Sequence[dict[str, Any]], path: Path) -> None:
    """Every figure over the commits, relative to its first value; log scale."""
    drawing = Drawing(figsize=(11, 5.5), layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.add_subplot()
    names = list(dict.fromkeys(name for entry in history for name in entry["figures"]))
    for number, name in enumerate(names):
        points = [(at, entry["figures"][name]) for at, entry in enumerate(history) if name in entry["figures"]]
        first = points[0][1] or 1.0
        style = "-" if number < 10 else "--"
        axes.plot(
            [at for at, _ in points], [value / first for _, value in points], f"o{style}", markersize=4, label=name
        )
    axes.set_yscale("log")
    axes.set_xticks(range(len(history)), [entry["commit"] for entry in history], rotation=45, ha="right", fontsize=7)
    axes.set_ylabel("relative to the first value; less is better")
    axes.grid(color="0.9", linewidth=0.6)
    drawing.legend(loc="outside right upper", fontsize=8, frameon=False)
    drawing.savefig(path, dpi=90)


def watch(threads: int, note: Callable[[str], None]) -> list[Finding]:
    """Measures, judges, and writes history and trend."""
    engines.OUTPUT.mkdir(parents=True, exist_ok=True)
    history: list[dict[str, Any]] = json.loads(HISTORY.read_text(encoding="utf-8")) if HISTORY.is_file() else []
    name = commit()
    figures = measure(threads, note)
    findings = judge(figures, [entry for entry in history if entry["commit"] != name])
    history = append(history, name, figures)
    HISTORY.write_text(json.dumps(history, indent=1) + "\n", encoding="utf-8")
    draw(history, TREND)
    return findings


def table(findings: Sequence[Finding]) -> str:
    """For people."""
    lines = [f"{'':36}{'now':>12}{'before':>12}{'ratio':>8}"]
    for found in findings:
        before, ratio = (
            ("", "") if found.before is None else (f"{found.before:.4g}", f"{found.value / found.before:.2f}")
        )
        lines.append(f"{found.name:36}{found.value:12.4g}{before:>12}{ratio:>8}{'  WORSE' if found.failed else ''}")
    return "\n".join(lines)


def results(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """For JSON, which has no infinity."""
    return [asdict(found) | {"value": found.value if math.isfinite(found.value) else None} for found in findings]
