"""Figures of the fault tests, printed as one table at the end: test, figure, bound, verdict."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

Record = Callable[[str, float, float], None]

FULL = os.environ.get("FOGBANK_FAULTS") == "full"
"""As `make test-faults` runs them; else a short part of each test."""

_FIGURES = pytest.StashKey[list[tuple[str, str, float, float]]]()


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
        request.config.stash[_FIGURES].append((request.node.name, what, figure, bound))

    return add


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Prints the table."""
    rows = config.stash[_FIGURES]
    if not rows:
        return
    terminalreporter.section("faults")
    terminalreporter.write_line(f"{'test':<44}{'figure':<40}{'value':>10}{'bound':>10}  verdict")
    for test, what, figure, bound in rows:
        verdict = "ok" if figure <= bound else "OVER"
        terminalreporter.write_line(f"{test:<44}{what:<40}{figure:>10.4g}{bound:>10.4g}  {verdict}")
