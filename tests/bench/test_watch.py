"""The regression watch: what counts as worse, on histories that are known."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from tests.bench import watch
from tests.bench.watch import Watched


def history(*values: float) -> list[dict[str, Any]]:
    """Entries with one figure."""
    return [{"commit": f"c{number}", "time": "", "figures": {"x": value}} for number, value in enumerate(values)]


def failed(value: float, tolerance: float, *before: float) -> bool:
    """Whether this is a regression."""
    (finding,) = watch.judge([Watched("x", value, tolerance)], history(*before))
    return finding.failed


def test_only_what_is_well_outside_noise_fails() -> None:
    """The first never; then beyond its tolerance of the median, so that one odd entry decides nothing."""
    assert not failed(100.0, 1.5)
    assert not failed(1.4, 1.5, 1.0, 1.0, 1.0)
    assert failed(1.6, 1.5, 1.0, 1.0, 1.0)
    assert failed(1.6, 1.5, 1.0, 1.0, 9.0)
    assert not failed(1.6, 1.5, 1.0, 1.0, 2.0, 2.0, 2.0)
    # What it was longer ago than five entries is forgotten.
    assert not failed(2.0, 1.5, *[1.0] * 9, *[2.0] * 5)


def test_better_is_no_failure_and_a_new_figure_is_none() -> None:
    """Less is better; figures come and go."""
    assert not failed(0.1, 1.5, 1.0)
    (finding,) = watch.judge([Watched("new", 5.0, 1.5)], history(1.0))
    assert finding.before is None
    assert not finding.failed
    (broken,) = watch.judge([Watched("x", math.inf, 1.5)], [])
    assert broken.failed
    assert watch.append([], "c", [Watched("x", math.inf, 1.5)])[0]["figures"] == {}
    assert "WORSE" in watch.table(watch.judge([Watched("x", 5.0, 1.5)], history(1.0)))


def test_a_commit_has_one_entry(tmp_path: Path) -> None:
    """Measured again it replaces itself, at the end; the trend is drawn, also with figures that are not everywhere."""
    entries = watch.append(history(1.0, 2.0), "c0", [Watched("x", 3.0, 1.5), Watched("y", 1.0, 1.5)])
    assert [(entry["commit"], entry["figures"]["x"]) for entry in entries] == [("c1", 2.0), ("c0", 3.0)]
    watch.draw(entries, tmp_path / "trend.png")
    assert (tmp_path / "trend.png").read_bytes().startswith(b"\x89PNG")
