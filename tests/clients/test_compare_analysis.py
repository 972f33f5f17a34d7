"""What tables of a comparison say, on runs whose errors are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from fogbank.comparison import analysis, pictures
from fogbank.comparison.runs import Run

LINE = [(1.0, 1e-2), (2.0, 5e-3), (4.0, 2.5e-3)]
"""Error falls as 0.01 / t."""


def run(method: str, seconds: float, error: float, seed: int = 1) -> Run:
    """A picture that took twice its seconds of CPU time."""
    return Run(
        method,
        seconds,
        seed,
        status="done",
        figures={"wall_seconds": seconds, "cpu_seconds": 2 * seconds},
        errors={"trimmed": error},
    )


def rows(times: pd.DataFrame) -> dict[tuple[float, str], dict[Any, Any]]:
    """By error and method."""
    return {(row["error"], row["method"]): row for row in times.to_dict("records")}


def test_cost_of_an_error() -> None:
    """By the power law between points, at the points, before the first and beyond the last."""
    assert analysis.cost_at(LINE, 4e-3) == pytest.approx(2.5)
    assert analysis.cost_at(LINE[::-1], 5e-3) == 2
    assert analysis.cost_at(LINE, 0.1) == 1
    assert analysis.cost_at(LINE, 1e-3) is None
    assert analysis.cost_at([], 1e-3) is None
    assert analysis.cost_at([(0.0, 1e-2), (3.0, 1e-4)], 1e-3) == 3
    assert analysis.cost_at([(1.0, 1e-2), (2.0, -1e-6)], 1e-3) == 2


def test_summary_is_of_seeds_and_leaves_failures_out() -> None:
    """Mean, spread and number of the seeds that were done."""
    runs = [
        run("a", 1, 0.1, 1),
        run("a", 1, 0.3, 2),
        Run("a", 1, 3, status="crashed", message="signal"),
        run("b", 1, 1),
    ]
    results = analysis.table(runs)
    assert list(results.columns) == list(analysis.COLUMNS)
    assert results["status"].tolist() == ["done", "done", "crashed", "done"]
    means = analysis.summary(results)
    first = means.iloc[0]
    assert (first["method"], first["seeds"], first["least"], first["greatest"]) == ("a", 2, 0.1, 0.3)
    assert first["trimmed"] == pytest.approx(0.2)
    assert first["cpu_seconds"] == 2


def test_times_and_ratios() -> None:
    """b needs three times as long as a for the same error, and never gets as far."""
    runs = [run("a", t, e) for t, e in LINE] + [run("b", 3 * t, e) for t, e in LINE[:2]]
    means = analysis.summary(analysis.table(runs))
    assert analysis.levels(means) == [5e-3]
    runs.append(run("b", 0.1, 0.3))
    means = analysis.summary(analysis.table(runs))
    assert analysis.levels(means) == [0.2, 0.1, 0.05, 0.02, 0.01, 0.005]
    times = rows(analysis.cost_to_error(means, ["a", "b"], "a", "wall_seconds"))
    assert times[0.005, "b"]["ratio"] == pytest.approx(3)
    assert times[0.005, "a"]["cost"] == pytest.approx(2)
    assert times[0.02, "a"]["at_most"]
    assert not times[0.02, "b"]["at_most"]
    in_cpu_time = rows(analysis.cost_to_error(means, ["a", "b"], "a", "cpu_seconds"))
    assert in_cpu_time[0.005, "a"]["cost"] == pytest.approx(4)


def test_verdicts_name_who_loses() -> None:
    """Curves that cross: a is better with 1 s, b with 4 s, and b alone reaches 1e-4."""
    runs = [run("a", 1, 1e-2), run("a", 4, 5e-3), run("b", 1, 3e-2), run("b", 4, 1e-4), run("c", 1, 2e-2)]
    means = analysis.summary(analysis.table(runs))
    times = analysis.cost_to_error(means, ["a", "b", "c"], "a", "cpu_seconds")
    against_b, against_c = analysis.verdicts(means, times, ["a", "b", "c"], "a")
    assert "a has the smaller error at budget 1;" in against_b
    assert "b has the smaller error at budget 4;" in against_b
    assert "only b reached 0.0001" in against_b
    assert "c has the smaller error" not in against_c


def test_insets_are_where_methods_differ() -> None:
    """Two of them differ in one corner, and a little in the opposite one."""
    reference = np.ones((64, 96, 3))
    image = reference.copy()
    image[8:20, 70:82] = 1.8
    image[44:56, 8:20] = 1.2
    first, second = pictures.choose_insets([reference, image], reference)[:2]
    assert (first.x <= 70 + 8) and (first.x + first.width >= 74) and (first.y <= 12)
    assert second.x <= 12 and second.y + second.height >= 50
    assert pictures.choose_insets([reference, reference], reference) == []
    tiny = np.ones((4, 4, 3))
    (only,) = pictures.choose_insets([tiny, 2 * tiny], tiny)
    assert (only.x, only.y, only.width, only.height) == (0, 0, 4, 4)
