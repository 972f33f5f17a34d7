"""Fixtures of the farm's tests: a coordinating server, clusters, and a table of figures at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import fogbank
import pytest
from fogbank import RenderOptions
from fogbank.farm.costs import Trips
from fogbank.paths import server_binary

from tests.farm.scenes import write_scene

Record = Callable[[str, float, str], None]

_TRIP_SECONDS = Trips.seconds


@dataclass(frozen=True)
class Alone:
    """What a server makes that has no farm, and an empty cache."""

    image: fogbank.Image
    """The picture."""

    records: int
    """That it made for it."""


Expected = Callable[[RenderOptions], Alone]

_FIGURES = pytest.StashKey[list[tuple[str, str, float, str]]]()

try:
    server_binary()
except fogbank.ServerStartError as absence:
    _NO_SERVER = str(absence)
else:
    _NO_SERVER = ""


def pytest_configure(config: pytest.Config) -> None:
    """A table without rows."""
    config.stash[_FIGURES] = []


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Prints the table."""
    rows = config.stash[_FIGURES]
    if not rows:
        return
    terminalreporter.section("farm")
    for test, what, figure, unit in rows:
        terminalreporter.write_line(f"{test:<76}{what:<50}{figure:>10.4g} {unit}")


@pytest.fixture
def record(request: pytest.FixtureRequest) -> Record:
    """Puts a figure into the table: what, how much, of which unit. Times are put down and never asserted."""

    def add(what: str, figure: float, unit: str) -> None:
        request.config.stash[_FIGURES].append((request.node.name, what, figure, unit))

    return add


@pytest.fixture(autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keeps the user's cache folder and settings out of the tests; skips where there is no server."""
    if _NO_SERVER:
        pytest.skip(f"NOT TESTED, no server: {_NO_SERVER}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    for variable in ("FOGBANK_DATA", "FOGBANK_SERVER", "FOGBANK_SCHEDULER"):
        monkeypatch.delenv(variable, raising=False)


@pytest.fixture(autouse=True)
def everything_travels(monkeypatch: pytest.MonkeyPatch) -> None:
    """What these tests render is so little that the coordinating server would do most of it by itself."""
    monkeypatch.setattr(Trips, "seconds", lambda _: 0.0)


@pytest.fixture
def trips_as_measured(everything_travels: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """But not those that ask for this."""
    monkeypatch.setattr(Trips, "seconds", _TRIP_SECONDS)


@pytest.fixture(scope="session")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Expected:
    """Pictures of the scene as one server makes them, each made once."""
    known: dict[str, Alone] = {}

    def alone(options: RenderOptions) -> Alone:
        key = repr(sorted(options.items()))
        if key not in known:
            folder = tmp_path_factory.mktemp("alone")
            with fogbank.connect(data=folder / "data", threads=2) as service:
                job = service.load(write_scene(folder / "scene")).render(**options)
                image = job.result()
                assert job.statistics is not None
                known[key] = Alone(image, job.statistics.records_new)
        return known[key]

    return alone


@pytest.fixture
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[fogbank.Service]:
    """A coordinating server with an empty cache."""
    with fogbank.connect(data=tmp_path_factory.mktemp("data"), threads=2) as service:
        yield service
