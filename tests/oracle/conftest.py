"""Fixtures of the oracle tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fogbank
import pytest

from tests.oracle.cases import REPOSITORY


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--fresh",
        action="store_true",
        help="oracle: render Mitsuba's references anew instead of reading the stored ones (needs the mitsuba wheel)",
    )


@pytest.fixture(scope="session")
def fresh(request: pytest.FixtureRequest) -> bool:
    """Whether references are rendered anew. The default is for runs of the whole suite: pytest reads this file too late
    then to know the option."""
    return bool(request.config.getoption("--fresh", default=False))


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[fogbank.Service]:
    """An embedded server with a data directory of its own."""
    with fogbank.connect(data=tmp_path_factory.mktemp("data")) as connection:
        yield connection


@pytest.fixture
def own_service(tmp_path: Path) -> Iterator[fogbank.Service]:
    """An embedded server for one test, which begins with empty caches."""
    with fogbank.connect(data=tmp_path / "data") as connection:
        yield connection


@pytest.fixture(scope="session")
def evidence() -> Path:
    """Where pictures of failures go; ignored by git."""
    return REPOSITORY / "out" / "oracle"
