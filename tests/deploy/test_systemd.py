"""The systemd unit: systemd's own checks, and what a server asks of the kernel against what the unit allows."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path

import fogbank
from fogbank.credentials import Credentials
from fogbank.paths import server_binary
from fogbank.tokens import SCOPES, TokenFile

from tests.deploy.examples import DEPLOY, REPOSITORY, free_port, run, tool
from tests.service.harness import PATIENCE_SECONDS

UNIT = DEPLOY / "systemd" / "fogbankd.service"
EXPOSURE = 15
"""Tenths, 0 to 100, that `systemd-analyze security` may find: a service that listens on loopback and writes to one
folder has 11, one without any setting 96."""


def settings(name: str) -> list[str]:
    """Values of a setting, in order."""
    return re.findall(rf"^{name}=(.*)$", UNIT.read_text(), re.MULTILINE)


def test_unit_is_valid(tmp_path: Path) -> None:
    # systemd looks for the program, which is not installed here.
    copy = tmp_path / UNIT.name
    copy.write_text(UNIT.read_text().replace("/usr/local/bin/fogbankd", str(server_binary())))
    verified = run(tool("systemd-analyze"), "verify", "--man=no", str(copy))
    assert (verified.returncode, verified.stdout + verified.stderr) == (0, "")


def test_unit_is_hardened() -> None:
    rated = run(
        tool("systemd-analyze"), "security", "--offline=true", f"--threshold={EXPOSURE}", "--no-pager", str(UNIT)
    )
    assert rated.returncode == 0, rated.stdout


def test_user_and_folder_of_the_unit_are_made() -> None:
    (line,) = (DEPLOY / "systemd" / "fogbank.conf").read_text().splitlines()
    assert line.split()[:2] == ["u", *settings("User")]
    (state,) = settings("StateDirectory")
    assert line.split()[-1] == f"/var/lib/{state}"
    assert f"--data /var/lib/{state} " in settings("ExecStart")[0]


def allowed_system_calls() -> set[str]:
    """What SystemCallFilter= leaves, its groups as systemd knows them."""
    listed = run(tool("systemd-analyze"), "syscall-filter", "--no-pager").stdout
    groups: dict[str, list[str]] = {}
    for line in listed.splitlines():
        if line.startswith("@"):
            group = groups.setdefault(line.strip(), [])
        elif line.startswith("    ") and not line.strip().startswith("#"):
            group.append(line.strip())

    def members(name: str) -> set[str]:
        return {member for each in groups[name] for member in members(each)} if name.startswith("@") else {name}

    allowed: set[str] = set()
    for value in settings("SystemCallFilter"):
        names = {member for name in value.removeprefix("~").split() for member in members(name)}
        allowed = allowed - names if value.startswith("~") else allowed | names
    return allowed


def test_a_server_gets_by_with_what_the_unit_allows(tmp_path: Path) -> None:
    """From start to stop, with a render and metrics: no other system call, and no memory both written and run."""
    allowed = allowed_system_calls()
    data, trace, port, metrics = tmp_path / "data", tmp_path / "trace", free_port(), free_port()
    data.mkdir()
    _, token = TokenFile(data).create("studio", SCOPES, 3600.0)
    command = [tool("strace"), "-f", "-qq", "-o", str(trace), str(server_binary()), "--data", str(data)]
    command += ["--listen", f"127.0.0.1:{port}", "--metrics", f"127.0.0.1:{metrics}", "--require-tokens"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        credentials = Credentials(token=token)
        patience = fogbank.RetryPolicy(attempts=30)
        with fogbank.connect(f"127.0.0.1:{port}", credentials=credentials, retry_policy=patience) as service:
            scene = service.load(REPOSITORY / "scenes" / "shafts" / "shafts.xml")
            scene.render(integrator="radiance-cache", size=(16, 16), error=0.5).result()
        assert run(tool("curl"), "--silent", f"http://127.0.0.1:{metrics}/metrics").returncode == 0
    finally:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        for child in children:
            subprocess.run(["kill", f"-{signal.SIGTERM.value}", child], check=True)
        process.wait(PATIENCE_SECONDS)
    calls = trace.read_text()
    used = set(re.findall(r"^\d+ +(\w+)\(", calls, re.MULTILINE))
    assert "openat" in used
    # The first one is strace's own; what the unit refuses with EPERM must be refused, or not asked for, here too.
    assert used - allowed - {"execve"} == set()
    assert not re.findall(r"^.*PROT_WRITE\|PROT_EXEC.*$", calls, re.MULTILINE)
