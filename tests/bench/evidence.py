"""The README's comparison: reports of all its scenes, then the table and the plot between the README's markers.

    python -m tests.bench.evidence [--budgets 1,2,5,10,30,60] [--seeds 3] [--reference SECONDS] [--scale 1] [SCENE ...]

Reports go to out/evidence/SCENE/report.html. What is there isn't made again, so an interrupted run goes on; other
settings and other builds need another --output or an empty one. Nothing in the README's section is typed by hand.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fogbank
import pandas as pd
from fogbank.comparison import BUDGETS, SEEDS, machine
from fogbank.comparison.analysis import choose_base, cost_at, curve, levels
from fogbank.comparison.comparison import Comparison
from fogbank.comparison.plots import error_plots

from tests.bench.engines import ROOT, SHARED

README = ROOT / "README.md"
PLOT = Path("tests/bench/evidence.png")
BEGIN = "<!-- evidence: made by `make evidence`, don't edit -->"
END = "<!-- end of evidence -->"


@dataclass(frozen=True)
class EvidenceScene:
    """A scene of the table."""

    name: str
    path: Path
    size: tuple[int, int]
    reference: Path | None = None
    """Somebody else's, of this size; else one is made."""
    max_depth: int | None = None
    """What that reference was rendered with; the scene's by default."""


def scenes() -> list[EvidenceScene]:
    """Ours, and those of the shared data."""
    ours = [
        EvidenceScene(name, ROOT / "scenes" / name / f"{name}.xml", (256, 256))
        for name in ("shafts", "stairs", "penumbra", "glow")
    ]
    references = SHARED / "references"
    return [
        *ours,
        EvidenceScene(
            "room_fog",
            SHARED / "data/statues/room_fog.xml",
            (192, 108),
            references / "statues_room_fog.exr",
            24,
        ),
        EvidenceScene(
            "staircase2", SHARED / "data/staircase2/fog.xml", (192, 108), references / "staircase2_fog.exr", 24
        ),
    ]


def compare(scene: EvidenceScene, options: argparse.Namespace) -> Comparison:
    """The scene's report."""
    size = tuple(max(8, round(side * options.scale)) for side in scene.size)
    # A reference of another size is of no use.
    theirs = scene.reference if size == scene.size and scene.reference and scene.reference.is_file() else None
    return fogbank.compare(
        scene.path,
        options.output / scene.name,
        budgets=options.budgets,
        seeds=options.seeds,
        size=(size[0], size[1]),
        max_depth=scene.max_depth,
        reference=theirs,
        make_reference=None if theirs else options.reference,
        command=f"make evidence BUDGETS={','.join(f'{budget:g}' for budget in options.budgets)} SEEDS={options.seeds}",
        on_progress=lambda progress: print(f"{scene.name}: {progress.fraction:4.0%} {progress.doing}", flush=True),
    )


def table(found: dict[str, Comparison]) -> list[str]:
    """CPU seconds to the smallest error that the base reached, and the ratio to the base."""
    methods = list(dict.fromkeys(method for item in found.values() for method in item.table["method"]))
    base = choose_base(methods)
    lines = [
        "| scene | relative MSE | " + " | ".join(methods) + " |",
        "| --- | ---: |" + " ---: |" * len(methods),
    ]
    for name, item in found.items():
        means = item.summary
        reached = [level for level in levels(means) if cost_at(curve(means, base, "cpu_seconds"), level)]
        if not reached:
            lines.append(f"| {name} | - |" + f" {base} has no picture |" + " |" * (len(methods) - 1))
            continue
        cells = cells_of(means, methods, base, min(reached))
        lines.append(f"| {name} | {min(reached):g} | " + " | ".join(cells) + " |")
    return lines


def cells_of(means: pd.DataFrame, methods: Sequence[str], base: str, level: float) -> list[str]:
    """Seconds of each method, and by those of the base."""
    mine = cost_at(curve(means, base, "cpu_seconds"), level)
    cells = []
    for method in methods:
        points = curve(means, method, "cpu_seconds")
        seconds = cost_at(points, level)
        if not points:
            cells.append("not run")
        elif seconds is None:
            cells.append(f"over {points[-1][0]:.2g}")
        else:
            at_most = "≤ " if points[0][1] <= level else ""
            ratio = f" (x{seconds / mine:.2g})" if mine and method != base else ""
            cells.append(f"{at_most}{seconds:.2g}{ratio}")
    return cells


def losses(found: dict[str, Comparison]) -> list[str]:
    """Where the base isn't the best at equal time."""
    lines = []
    for name, item in found.items():
        errors = item.summary.pivot(index="budget", columns="method", values="trimmed")
        base = choose_base(list(errors.columns))
        for budget, row in errors.iterrows():
            best = str(row.idxmin())
            if best != base:
                factor = f"{row[base] / row[best]:.2g}" if row[best] > 0 else "more than the reference can tell"
                lines.append(f"{name} at {budget:g} s: {best} {factor}")
    return lines


def wrapped(text: str) -> str:
    """As the README's own lines."""
    return textwrap.fill(text, 120, break_on_hyphens=False)


def section(found: dict[str, Comparison], options: argparse.Namespace) -> str:
    """What stands between the markers."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    sizes = sorted({f"{item.reference.half_a.shape[1]}x{item.reference.half_a.shape[0]}" for item in found.values()})
    budgets = ", ".join(f"{budget:g}" for budget in options.budgets)
    facts = machine.describe()
    lost = losses(found)
    lines = [
        BEGIN,
        wrapped(
            "CPU seconds to a relative MSE (worst 0.1 % of the pixels left out), in brackets by those of the cache;"
            f" {', '.join(sizes)}, budgets of {budgets} s, {options.seeds} pictures of each, caches empty at first."
            f" Commit {commit}, {facts['processor']}, load {facts['load average']}, {facts['time']}."
        ),
        "",
        *table(found),
        "",
        f"![Error against CPU time, a panel for each scene]({PLOT})",
        "",
        wrapped(
            f"At equal time something else has the smaller error, by this factor: {'; '.join(lost)}."
            if lost
            else "At equal time nothing else has a smaller error."
        ),
    ]
    missing = [scene.name for scene in scenes() if scene.name not in found]
    if missing:
        lines.append(f"Not compared: {', '.join(missing)}.")
    return "\n".join([*lines, END])


def main() -> None:
    """Compares, then writes the README's section and plot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", nargs="*", help="all of them by default")
    parser.add_argument(
        "--budgets", type=lambda text: tuple(map(float, text.split(","))), default=BUDGETS, help="seconds, N,N,..."
    )
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--reference", type=float, help="seconds for each; 20 times the largest budget by default")
    parser.add_argument("--scale", type=float, default=1.0, help="of the images' sides")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "evidence")
    options = parser.parse_args()
    found: dict[str, Comparison] = {}
    for scene in scenes():
        if options.scene and scene.name not in options.scene:
            continue
        if not scene.path.is_file():
            print(f"NOT COMPARED: {scene.name}: {scene.path} is not there (the shared data)", flush=True)
            continue
        try:
            found[scene.name] = compare(scene, options)
        except fogbank.FogbankError as error:
            raise SystemExit(f"{scene.name}: {error}") from None
        print(found[scene.name].report, flush=True)
    error_plots({name: item.summary for name, item in found.items()}, ROOT / PLOT)
    text = README.read_text(encoding="utf-8")
    marked = re.compile(re.escape(BEGIN) + ".*?" + re.escape(END), re.DOTALL)
    if not marked.search(text):
        raise SystemExit(f"{README} has no section between {BEGIN!r} and {END!r}")
    README.write_text(marked.sub(lambda _: section(found, options), text), encoding="utf-8")


if __name__ == "__main__":
    main()
