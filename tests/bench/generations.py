"""Cost and error of records of reflected and multiply scattered light, by generation: generations_bench."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.bench.engines import BINARIES, ROOT

DIRECTIONS = (16, 64, 256, 1024)
POINTS = 4
SEEDS = 4
REFERENCE_PATHS = 50000


def scenes() -> dict[str, Path]:
    """Scenes by name."""
    return {name: ROOT / "scenes" / name / f"{name}.xml" for name in ("shafts", "stairs", "glow")}


def measure(scene: Path) -> list[dict[str, Any]]:
    """Lines of generations_bench: cost and error of records by generation and directions."""
    completed = subprocess.run(
        [
            str(BINARIES / "generations_bench"),
            str(scene),
            *map(str, (POINTS, SEEDS, REFERENCE_PATHS, *DIRECTIONS)),
        ],
        stdout=subprocess.PIPE,
        cwd=ROOT,
        check=True,
    )
    return [json.loads(line) for line in completed.stdout.splitlines()]


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Errors relative to the value; gain: time of generation 0 for the same noise, over the record's own."""
    lines = ["          generation directions       ms     rays   error   noise  stated   gain"]
    for name, found in results.items():
        traced = {line["directions"]: line for line in found if line.get("generation") == 0}
        for line in found:
            if "generation" not in line:
                continue
            first = traced[line["directions"]]
            cost = line["seconds"] * line["rms_noise"] ** 2
            gain = first["seconds"] * first["rms_noise"] ** 2 / cost if cost > 0 else float("inf")
            lines.append(
                f"{name:10}{line['generation']:10}{line['directions']:11}"
                f"{1e3 * line['seconds']:9.2f}{line['rays']:9.0f}"
                f"{line['rms_error']:8.1%}{line['rms_noise']:8.1%}{line['stated_noise']:8.1%}{gain:7.1f}"
            )
    return "\n".join(lines)
