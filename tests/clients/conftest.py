"""Fixtures of the client tests."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

import fogbank
import pytest

from tests.clients.fake_server import FakeServer

ROOT = Path(__file__).resolve().parents[2]

# Waits in tests would only cost time; the number of tries is what matters.
PATIENT = fogbank.RetryPolicy(attempts=5, sleep=lambda seconds: None)


@pytest.fixture(autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keeps the user's cache folder and settings out of the tests."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    for variable in ("FOGBANK_DATA", "FOGBANK_SERVER"):
        monkeypatch.delenv(variable, raising=False)


@pytest.fixture
def fake() -> Iterator[FakeServer]:
    """A fake server, not yet listening."""
    server = FakeServer()
    yield server
    server.stop()


@pytest.fixture
def address(fake: FakeServer) -> str:
    """Where the fake server listens."""
    return f"127.0.0.1:{fake.start('127.0.0.1:0')}"


@pytest.fixture
def service(address: str) -> Iterator[fogbank.Service]:
    """A client of the fake server."""
    with fogbank.connect(address, retry_policy=PATIENT) as service:
        yield service


@pytest.fixture
def scene_path(tmp_path: Path) -> Path:
    """A scene of two files in a folder of its own."""
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "mesh.ply").write_bytes(bytes(range(256)) * 4)
    path = folder / "fog.xml"
    path.write_text('<scene version="3.0.0">\n  <shape type="ply" filename="mesh.ply"/>\n</scene>\n')
    return path


@pytest.fixture
def scene(service: fogbank.Service, scene_path: Path) -> fogbank.Scene:
    """The scene, loaded."""
    return service.load(scene_path)


@pytest.fixture
def fake_binary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The fake server as the program that embedded servers run."""
    binary = tmp_path / "fogbankd"
    binary.write_text(
        f'#!/bin/sh\nPYTHONPATH="{os.pathsep.join([str(ROOT), *sys.path])}" exec "{sys.executable}"'
        ' -m tests.clients.fake_fogbankd "$@"\n'
    )
    binary.chmod(binary.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("FOGBANK_SERVER_BINARY", str(binary))
    return binary
