"""The files of deploy/ as data, and what the tests of them share."""

from __future__ import annotations

import re
import shlex
import shutil
import socket
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
REPOSITORY = DEPLOY.parent


def tool(name: str) -> str:
    """A program's path; skips the test, saying so, where it is absent."""
    found = shutil.which(name) or shutil.which(name, path=str(REPOSITORY / ".venv" / "bin"))
    if found is None:
        pytest.skip(f"{name} is absent")
    return found


def run(*command: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:  # noqa: ANN401 - subprocess.run's
    """Runs a program to its end; its output as text."""
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, **options)


def free_port() -> int:
    """A port of loopback that nobody listens on now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def compose() -> dict[str, Any]:
    """compose.yaml, its anchors resolved."""
    found: dict[str, Any] = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
    return found


def manifests() -> list[dict[str, Any]]:
    """Every object of kubernetes/*.yaml."""
    files = sorted((DEPLOY / "kubernetes").glob("*.yaml"))
    return [found for path in files for found in yaml.safe_load_all(path.read_text())]


def manifest(kind: str, name: str) -> dict[str, Any]:
    """One of them."""
    return next(found for found in manifests() if found["kind"] == kind and found["metadata"]["name"] == name)


def unit_command() -> list[str]:
    """ExecStart of the systemd unit."""
    text = (DEPLOY / "systemd" / "fogbankd.service").read_text()
    line = re.search(r"^ExecStart=(.*)$", text, re.MULTILINE)
    assert line is not None
    return shlex.split(line[1])


def image_instructions(target: str) -> list[tuple[str, str]]:
    """Instructions of one stage of the Dockerfile, in order, their lines joined: ("RUN", "apt-get ...")."""
    text = re.sub(r"^\s*#.*\n", "", (DEPLOY / "Dockerfile").read_text(), flags=re.MULTILINE)
    stages = re.split(r"(?=^FROM )", text.replace("\\\n", ""), flags=re.MULTILINE)
    stage = next(stage for stage in stages if re.match(rf"FROM \S+ AS {target}\n", stage))
    pairs = (line.split(None, 1) for line in stage.splitlines() if line.strip())
    return [(word, rest.strip()) for word, rest in pairs]
