"""fogbankd starts with the arguments that the examples give it, and says that it is healthy in the way they ask."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.deploy.conftest import Deployed, Pki
from tests.deploy.examples import (
    DEPLOY,
    compose,
    free_port,
    image_instructions,
    manifest,
    run,
    tool,
    unit_command,
)
from tests.service.harness import Server

HEALTH_CHECK = DEPLOY / "health-check.sh"


def server_container() -> dict[str, object]:
    """fogbankd's in the Kubernetes manifest."""
    containers = manifest("StatefulSet", "fogbank")["spec"]["template"]["spec"]["containers"]
    return next(container for container in containers if container["name"] == "fogbankd")


def image_command() -> list[str]:
    """CMD of the image."""
    return [str(word) for word in json.loads(dict(image_instructions("server"))["CMD"])]


def command_lines() -> dict[str, list[str]]:
    """fogbankd's arguments, by where they stand."""
    entry = json.loads(dict(image_instructions("server"))["ENTRYPOINT"])
    assert entry[0] == "fogbankd"
    return {
        "image": entry[1:] + image_command(),
        "compose": entry[1:] + compose()["services"]["server"]["command"],
        "kubernetes": entry[1:] + list(server_container()["args"]),  # type: ignore[call-overload]
        "systemd": unit_command()[1:],
    }


@pytest.mark.parametrize("where", ["image", "compose", "kubernetes", "systemd"])
def test_server_starts(where: str, tmp_path: Path) -> None:
    (tmp_path / "scenes").mkdir()
    arguments = " ".join(command_lines()[where])
    # Another port and another folder; everything else as it stands there.
    metrics = free_port()
    assert re.search(r":9464\b", arguments)
    arguments = re.sub(r":9464\b", f":{metrics}", arguments)
    arguments, folders = re.subn(r"--data[ =]\S+ ?", "", arguments)
    arguments = arguments.replace("/scenes", str(tmp_path / "scenes"))
    listen = re.search(r"--listen[ =](\S+)", arguments)
    assert listen is not None
    assert listen[1] == "127.0.0.1:7071"
    assert folders == 1
    arguments = arguments.replace(listen[0], "")
    server = Server(tmp_path / "data", *arguments.split())
    try:
        assert run(HEALTH_CHECK, f"http://{server.target}").returncode == 0
        assert "fogbank_jobs" in run(tool("curl"), "--silent", f"http://127.0.0.1:{metrics}/metrics").stdout
    finally:
        assert server.stop() == 0


def test_health_checks_ask_where_the_server_listens() -> None:
    target = "http://127.0.0.1:7071"
    assert dict(image_instructions("server"))["HEALTHCHECK"].endswith(f'CMD ["health-check.sh", "{target}"]')
    container = server_container()
    for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
        assert container[probe]["exec"]["command"] == ["health-check.sh", target]  # type: ignore[index]


def test_health_check_sees_the_difference(deployed: Deployed, pki: Pki, tmp_path: Path) -> None:
    tool("curl")
    assert run(HEALTH_CHECK, f"http://{deployed.server.target}").returncode == 0
    nobody = run(HEALTH_CHECK, f"http://127.0.0.1:{free_port()}")
    assert nobody.returncode != 0
    # Answers HTTP, but is no gRPC server.
    assert run(HEALTH_CHECK, f"http://{deployed.metrics}").returncode != 0
    files = ("--tls-certificate", str(pki.server.certificate), "--tls-key", str(pki.server.key))
    encrypted = Server(tmp_path / "data", *files)
    try:
        trusting = {"CURL_CA_BUNDLE": str(pki.authority), "PATH": "/usr/bin:/bin"}
        assert run(HEALTH_CHECK, f"https://{encrypted.target}", env=trusting).returncode == 0
        assert run(HEALTH_CHECK, f"https://{encrypted.target}").returncode != 0
    finally:
        assert encrypted.stop() == 0


def dask_command_lines() -> list[list[str]]:
    """Those of the farm, defaults in place of variables."""
    services = compose()["services"]
    commands = [services[name]["command"] for name in ("scheduler", "worker")]
    for name in ("fogbank-scheduler", "fogbank-worker"):
        (container,) = manifest("Deployment", name)["spec"]["template"]["spec"]["containers"]
        commands.append(container["args"])
    return [[re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", str(word)) for word in command] for command in commands]


@pytest.mark.parametrize("command", dask_command_lines(), ids=lambda command: command[1])
def test_dask_knows_the_options(command: list[str]) -> None:
    assert command[0] == "dask"
    program = pytest.importorskip(f"distributed.cli.dask_{command[1]}")
    # Reads the arguments and checks their types, and starts nothing.
    program.main.make_context(command[1], list(command[2:]))
