"""What a record costs, stage by stage, and packets of rays against single ones: record_bench."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.bench.engines import BINARIES, ROOT, SHARED

DIRECTIONS = (256, 1024, 4096, 16384, 65536, 262144, 1048576)
POINTS = 20


def scenes() -> dict[str, Path]:
    """Scenes by name; the shared ones where they are there."""
    found = {name: ROOT / "scenes" / name / f"{name}.xml" for name in ("penumbra", "shafts")}
    shared = {"statues": SHARED / "data/statues/room_fog.xml", "classroom": SHARED / "data/classroom/fog.xml"}
    return found | {name: path for name, path in shared.items() if path.exists()}


def measure(scene: Path, directions: tuple[int, ...]) -> list[dict[str, Any]]:
    """Seconds of every stage of a record, by number of directions."""
    completed = subprocess.run(
        [str(BINARIES / "record_bench"), str(scene), str(POINTS), *map(str, directions)],
        stdout=subprocess.PIPE,
        cwd=ROOT,
        check=True,
    )
    return [json.loads(line) for line in completed.stdout.splitlines()]


def overhead(record: dict[str, Any], *, bisected: bool) -> float:
    """Cost of gradient and Hessian on top of the value, all with the same rays unless outlines are bisected."""
    value = record["trace"] + record["radiance"] + record["value"]
    stages = ("outlines", "hessian_bisected") if bisected else ("jumps", "hessian")
    return float((sum(record[stage] for stage in stages) - record["value"]) / value)


def table(results: dict[str, list[dict[str, Any]]]) -> str:
    """Microseconds by stage; ray rates as ratios to Embree called for single rays with nothing around it."""
    lines = [
        "us a record           rays    trace radiance    jumps outlines gradient  Hessian bisected"
        "    derivatives on top: equal rays, bisected"
    ]
    for name, records in results.items():
        for record in records:
            stages = ("trace", "radiance", "jumps", "outlines", "gradient", "hessian", "hessian_bisected")
            cells = "".join(f"{1e6 * record[stage]:9.0f}" for stage in stages)
            share = f"{overhead(record, bisected=False):9.1%}{overhead(record, bisected=True):9.1%}"
            lines.append(f"{name:16}{record['rays']:10}{cells}{share:>31}")
    lines.append("")
    lines.append(
        "time over Embree's    rays    lines  closest      any   closest in a fan  any in a fan"
        "    (below 1: faster than single rays)"
    )
    for name, records in results.items():
        for record in records:
            pairs = (
                ("lines", "embree_closest", 9),
                ("packet_closest", "embree_closest", 9),
                ("packet_any", "embree_any", 9),
                ("packet_fan_closest", "embree_fan_closest", 19),
                ("packet_fan_any", "embree_fan_any", 14),
            )
            cells = "".join(f"{record[ours] / record[embree]:{width}.2f}" for ours, embree, width in pairs)
            lines.append(f"{name:16}{record['rays']:10}{cells}")
    return "\n".join(lines)
