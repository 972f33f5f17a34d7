"""HAProxy as in the example, in front of a server: what goes through, what does not, and how many connections."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import fogbank
import numpy as np
import psutil
import pytest
from fogbank.credentials import Credentials

from tests.deploy.conftest import Deployed, Pki
from tests.deploy.examples import DEPLOY, free_port, run, tool
from tests.service.harness import PATIENCE_SECONDS, fog_scene

CONFIGURATION = DEPLOY / "haproxy" / "haproxy.cfg"
CONNECTIONS_OF_ONE_ADDRESS = 64


@dataclass(frozen=True)
class Proxy:
    """A running HAProxy."""

    port: int
    log: Path


@pytest.fixture(scope="module")
def proxy(deployed: Deployed, pki: Pki, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxy]:
    """In front of `deployed`; the example with other ports and another folder."""
    haproxy = tool("haproxy")
    folder = tmp_path_factory.mktemp("haproxy")
    shutil.copy(pki.server.certificate, folder / "tls.crt")
    shutil.copy(pki.server.key, folder / "tls.key")
    text = CONFIGURATION.read_text()
    port = free_port()
    for old, new in (
        ("bind :7070", f"bind 127.0.0.1:{port}"),
        ("/etc/haproxy/tls/", f"{folder}/"),
        ("server fogbankd 127.0.0.1:7071", f"server fogbankd {deployed.server.target}"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    configuration = folder / "haproxy.cfg"
    configuration.write_text(text)
    # Once as a container has it, once as systemd starts it.
    bare = {name: value for name, value in os.environ.items() if name != "INVOCATION_ID"}
    for environment in (bare, {**bare, "INVOCATION_ID": "test"}):
        checked = run(haproxy, "-c", "-f", str(configuration), env=environment)
        assert checked.returncode == 0, checked.stderr
        assert "WARNING" not in checked.stderr
    log = folder / "log"
    with log.open("wb") as file:
        process = subprocess.Popen([haproxy, "-db", "-f", configuration], stdout=file, stderr=file, env=bare)
    end = time.monotonic() + PATIENCE_SECONDS
    while not reachable(port):
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, "HAProxy is not ready"
        time.sleep(0.05)
    yield Proxy(port, log)
    process.terminate()
    process.wait(PATIENCE_SECONDS)


def reachable(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def connected(proxy: Proxy, pki: Pki, token: str | None) -> fogbank.Service:
    credentials = Credentials(token=token, ca=pki.authority)
    return fogbank.connect(f"127.0.0.1:{proxy.port}", credentials=credentials)


def test_renders_through_the_proxy(proxy: Proxy, deployed: Deployed, pki: Pki, tmp_path: Path) -> None:
    scene_file = tmp_path / "fog.xml"
    scene_file.write_bytes(fog_scene(width=32, height=32, samples=1))
    with connected(proxy, pki, deployed.token) as service:
        job = service.load(scene_file).render(spp=2, pixel_type="float")
        through = np.asarray(job.result())
    with fogbank.connect(deployed.server.target, credentials=Credentials(token=deployed.token)) as service:
        directly = np.asarray(service.load(scene_file).render(spp=2, pixel_type="float").result())
    assert np.array_equal(through, directly)
    assert deployed.token.rpartition("_")[2] not in proxy.log.read_text()


def test_callers_without_token_are_refused(proxy: Proxy, pki: Pki) -> None:
    with pytest.raises(fogbank.FogbankError) as caught:
        connected(proxy, pki, None)
    assert caught.value.reason == "TOKEN_MISSING"


def test_only_calls_of_the_contract_go_through(proxy: Proxy, pki: Pki) -> None:
    curl = tool("curl")

    def status(*arguments: str) -> str:
        url = f"https://127.0.0.1:{proxy.port}"
        return run(
            curl, "--silent", "--cacert", str(pki.authority), "--output", "/dev/null", "--write-out", "%{http_code}",
            *(argument.replace("URL", url) for argument in arguments),
        ).stdout  # fmt: skip

    assert status("--http2", "URL/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo") == "404"
    assert status("--http2", "URL/metrics") == "404"
    assert run(
        DEPLOY / "health-check.sh",
        f"https://127.0.0.1:{proxy.port}",
        env={"CURL_CA_BUNDLE": str(pki.authority), "PATH": "/usr/bin:/bin"},
    ).returncode == 0  # fmt: skip


def test_idle_connections_are_capped_and_never_reach_the_server(proxy: Proxy, deployed: Deployed, pki: Pki) -> None:
    """Someone at another address opens what he can; the server does not see it, and others are served."""
    before = psutil.Process(deployed.server.process.pid).num_fds()
    idle = []
    try:
        for _ in range(90):
            attacker = socket.socket()
            attacker.bind(("127.0.0.2", 0))
            attacker.settimeout(60)
            # What is refused may be closed as soon as it is there.
            with contextlib.suppress(ConnectionError):
                attacker.connect(("127.0.0.1", proxy.port))
            idle.append(attacker)
        # HAProxy accepts in order, so an answer to this caller comes after all of them were looked at.
        with connected(proxy, pki, deployed.token) as service:
            assert service.capabilities.version
        refused = sum(is_closed(each) for each in idle)
        assert refused >= len(idle) - CONNECTIONS_OF_ONE_ADDRESS
        # This caller's connection, and one for health; none of the idle ones.
        assert psutil.Process(deployed.server.process.pid).num_fds() <= before + 2
    finally:
        for each in idle:
            each.close()


def is_closed(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True
