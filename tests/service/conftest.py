"""Fixtures of the service tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fogbank._generated.v1 import scene_pb2 as scene_messages

from tests.service.harness import Server, fog_scene


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that all tests share, which must survive them all."""
    server = Server(tmp_path_factory.mktemp("server"), "--threads", "2")
    yield server
    assert server.process.poll() is None, "the server died"
    assert server.stop() == 0


@pytest.fixture(scope="session")
def scene(server: Server) -> scene_messages.Scene:
    """A small foggy scene."""
    return server.create_scene(fog_scene())


@pytest.fixture
def own_server(tmp_path: Path) -> Iterator[Server]:
    """A server for one test that stops or restarts it."""
    server = Server(tmp_path / "data", "--threads", "2")
    yield server
    server.stop()
