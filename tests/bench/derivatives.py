"""Errors of derivatives in real scenes, and what leaving out unneeded terms saves.

The comparison's slow part is the reference: finite differences, seconds for each point.
"""

from __future__ import annotations

import json
import subprocess
from typing import Any

from tests.bench import engines


def compare(points: int, samples: int) -> list[str]:
    """Lines of the table of derivatives_comparison: every method against finite differences."""
    program = engines.BINARIES / "derivatives_comparison"
    answer = subprocess.run([program, str(points), str(samples)], check=True, capture_output=True, text=True)
    return answer.stdout.splitlines()


def measure_leaving_out() -> list[dict[str, Any]]:
    """CPU microseconds a record, with unneeded terms left out and computed all the same."""
    program = engines.BINARIES / "leaving_out_bench"
    answer = subprocess.run([program, "--benchmark_format=json"], check=True, capture_output=True, text=True)
    times: dict[str, dict[str, float]] = {}
    for run in json.loads(answer.stdout)["benchmarks"]:
        scene, _, mode = run["name"].rpartition("/")
        times.setdefault(scene, {})[mode] = run["cpu_time"]
    return [{"scene": scene, **modes} for scene, modes in times.items()]


def leaving_out_table(results: list[dict[str, Any]]) -> str:
    """For people."""
    lines = ["a record of                     us    everything on   saved"]
    lines += [
        f"{result['scene']:24} {result['planned']:10.1f} {result['everything']:16.1f}"
        f" {1 - result['planned'] / result['everything']:7.0%}"
        for result in results
    ]
    return "\n".join(lines)
