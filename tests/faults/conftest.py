"""Figures of the fault tests, printed as one table at the end: test, figure, bound, verdict."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

Record = Callable[[str, float, float], None]

FULL = os.environ.get("FOGBANK_FAULTS") == "full"
"""As `make test-faults` runs them; else a short part of each test."""

ROWS = os.environ.get("FOGBANK_FAULT_ROWS")
"""File that rows are added to as they come, a line each, for run.py: a run that is ended early has a table, too."""

Row = tuple[str, str, float, float]
"""Test, figure, value, bound."""

_FIGURES = pytest.StashKey[list[Row]]()


def pytest_configure(config: pytest.Config) -> None:
    """A table without rows."""
    config.stash[_FIGURES] = []


@pytest.fixture
def record(request: pytest.FixtureRequest) -> Record:
    """Adds a row: what was measured, its value, and the greatest value that is good.

    A count that must hold is asserted by the test as well. A time is only put down: how long something takes on a
    machine that others use is no reason to fail.
    """

    def add(what: str, figure: float, bound: float) -> None:
        row = (request.node.name, what, figure, bound)
        request.config.stash[_FIGURES].append(row)
        if ROWS:
            with Path(ROWS).open("a") as file:
                file.write(json.dumps(row) + "\n")

    return add


def table(rows: Sequence[Row]) -> list[str]:
    """Its lines."""
    lines = [f"{'test':<44}{'figure':<58}{'value':>10}{'bound':>10}  verdict"]
    for test, what, figure, bound in rows:
        verdict = "ok" if figure <= bound else "OVER"
        lines.append(f"{test:<44}{what:<58}{figure:>10.4g}{bound:>10.4g}  {verdict}")
    return lines


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Prints the table, unless run.py does."""
    rows = config.stash[_FIGURES]
    if rows and not ROWS:
        terminalreporter.section("faults")
        for line in table(rows):
            terminalreporter.write_line(line)
