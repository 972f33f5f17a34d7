"""Look-ups in the radiance cache's index and the time to publish an epoch: cache_bench."""

from __future__ import annotations

import json
import subprocess
from typing import Any

from tests.bench.engines import BINARIES, ROOT


def measure() -> list[dict[str, Any]]:
    """google-benchmark's runs: look-ups along neighbouring rays and at random points, publication of an epoch."""
    completed = subprocess.run(
        [str(BINARIES / "cache_bench"), "--benchmark_min_time=0.2", "--benchmark_format=json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        check=True,
    )
    runs: list[dict[str, Any]] = json.loads(completed.stdout)["benchmarks"]
    return runs


def table(runs: list[dict[str, Any]]) -> str:
    """Millions of look-ups per CPU second of one core, records that each found, bytes a record with its index."""
    lines = [f"{'':42}{'M/s':>8}{'records found':>16}{'bytes a record':>16}{'wall ms':>10}"]
    for run in runs:
        milliseconds = run["real_time"] * {"ns": 1e-6, "us": 1e-3, "ms": 1.0, "s": 1e3}[run["time_unit"]]
        rate = f"{run['items_per_second'] / 1e6:8.2f}" if "records" in run else " " * 8
        found = f"{run['records']:16.1f}" if "records" in run else " " * 16
        size = f"{run['bytes']:16.0f}" if "bytes" in run else " " * 16
        lines.append(f"{run['name']:42}{rate}{found}{size}{milliseconds:10.3f}")
    return "\n".join(lines)
