"""The batch of form factors against single triangles and the peak of the core: form_factor_bench."""

from __future__ import annotations

import json
import subprocess
from typing import Any

from tests.bench.engines import BINARIES, ROOT

ORDERS = ("value", "+ gradient", "+ Hessian")
# Operations a triangle by order, a fused multiply-add counting as two: form_factor_bench.cpp says what they are.
OPERATIONS = (80, 170, 330)


def measure(repetitions: int) -> dict[str, Any]:
    """Items per second by benchmark, the best of the repetitions: others on the machine only ever slow them."""
    completed = subprocess.run(
        [
            str(BINARIES / "form_factor_bench"),
            f"--benchmark_repetitions={repetitions}",
            "--benchmark_min_time=0.1",
            "--benchmark_format=json",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        check=True,
    )
    rates: dict[str, float] = {}
    for run in json.loads(completed.stdout)["benchmarks"]:
        if run["run_type"] == "iteration":
            name = run["run_name"]
            rates[name] = max(rates.get(name, 0.0), run["items_per_second"])
    return rates


def table(rates: dict[str, float]) -> str:
    """Nanoseconds a triangle, and the batch's share of the peak."""
    lines = [f"{'ns/triangle':22}{'float':>10}{'of peak':>10}{'double':>10}{'of peak':>10}"]

    def row(label: str, names: list[str], operations: int) -> None:
        cells = ""
        for name, real in zip(names, ("float", "double"), strict=True):
            share = rates[name] * operations / rates[f"peak<{real}>"]
            cells += f"{1e9 / rates[name]:10.1f}" + (f"{share:10.0%}" if operations else " " * 10)
        lines.append(f"{label:22}{cells}")

    for order, label in enumerate(ORDERS):
        names = [f"batch<{real}>/derivatives:{order}" for real in ("float", "double")]
        row(f"batch, {label}", names, OPERATIONS[order])
    for order, label in enumerate(ORDERS):
        row(f"sum, {label}", [f"radiance<{real}>/derivatives:{order}" for real in ("float", "double")], 0)
    row("single, value", ["one_value<float>", "one_value<double>"], 0)
    row("single, jet", ["one_jet<float>", "one_jet<double>"], 0)
    peaks = ", ".join(f"{rates[f'peak<{real}>'] / 1e9:.0f} Gflop/s {real}" for real in ("float", "double"))
    return "\n".join(lines) + f"\nmultiply-add peak of the core: {peaks}"
