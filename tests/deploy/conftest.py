"""Fixtures of the deployment tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from fogbank.certificates import CertificateFiles, issue_server, make_authority
from fogbank.tokens import SCOPES, TokenFile

from tests.deploy.examples import free_port
from tests.service.harness import Server

HOUR = 3600.0


@dataclass(frozen=True)
class Deployed:
    """A server as the examples start it: on loopback, asking for tokens, with metrics."""

    server: Server
    metrics: str
    """HOST:PORT"""
    token: str


@pytest.fixture(scope="session")
def deployed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Deployed]:
    """A server that the tests of this folder share."""
    data = tmp_path_factory.mktemp("deployed")
    _, token = TokenFile(data).create("studio", SCOPES, HOUR)
    metrics = f"127.0.0.1:{free_port()}"
    server = Server(data, "--require-tokens", "--metrics", metrics, "--threads", "2")
    yield Deployed(server, metrics, token)
    assert server.stop() == 0


@dataclass(frozen=True)
class Pki:
    """Certificates as `fogbank tls init` makes them."""

    authority: Path
    server: CertificateFiles


@pytest.fixture(scope="session")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Pki:
    """For a server on 127.0.0.1."""
    folder = tmp_path_factory.mktemp("pki")
    authority = make_authority(folder)
    return Pki(authority.certificate, issue_server(folder, ["127.0.0.1", "localhost"]))
