"""The Slurm script, and workers that Dask submits, in a Slurm of one node that the test starts: `make test-deploy`.

Needs Debian's slurmctld, slurmd, slurm-client and munge: `install-tools.sh`, which `make test-deploy` runs before.
"""

from __future__ import annotations

import getpass
import json
import os
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fogbank.comparison import image_error

from tests.deploy.examples import DEPLOY, REPOSITORY, free_port, run, tool
from tests.service.harness import PATIENCE_SECONDS

pytestmark = pytest.mark.deployment
SCRIPT = DEPLOY / "slurm" / "fogbank-farm.sbatch"
SCENE = REPOSITORY / "scenes" / "penumbra" / "penumbra.xml"
# Enough that the server doesn't do it by itself.
OPTIONS = ["--spp", "16", "--size", "160x160", "--integrator", "volpath"]

CONFIGURATION = """
ClusterName=fogbank
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=4096 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
"""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment in which sbatch finds a Slurm with this machine as its only node."""
    programs = {name: tool(name) for name in ("munged", "slurmctld", "slurmd", "sbatch", "sinfo")}
    if os.geteuid() != 0:
        pytest.skip("root is needed, for slurmd")
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "key").write_bytes(os.urandom(128))
    (folder / "key").chmod(0o600)
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(
            folder=folder, host=socket.gethostname().partition(".")[0], user=getpass.getuser(), cpus=os.cpu_count(),
            controller_port=free_port(), node_port=free_port(),
        )
    )  # fmt: skip
    environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
    munge = [
        programs["munged"],
        "--foreground",
        "--force",
        f"--key-file={folder}/key",
        f"--socket={folder}/munge.socket",
    ]
    munge += [f"--{kind}-file={folder}/munge.{kind}" for kind in ("pid", "log", "seed")]
    daemons = [
        subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for command in (munge, [programs["slurmctld"], "-D"], [programs["slurmd"], "-D"])
    ]
    try:
        end = time.monotonic() + PATIENCE_SECONDS
        while "idle" not in run(programs["sinfo"], "--noheader", "--format=%T", env=environment).stdout:
            assert time.monotonic() < end, (folder / "slurmctld.log").read_text()
            time.sleep(0.5)
        yield environment
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
        for daemon in daemons:
            daemon.wait(PATIENCE_SECONDS)


def test_script_renders(slurm: dict[str, str], tmp_path: Path) -> None:
    """The picture is that of one machine, bit for bit, and nothing of the job's certificates is left."""
    path = f"{REPOSITORY}/.venv/bin:{slurm['PATH']}"
    submitted = run(
        tool("sbatch"), "--wait", "--cpus-per-task=2", "--mem-per-cpu=1G", str(SCRIPT), "render", str(SCENE), *OPTIONS,
        "-o", "farm.exr", cwd=tmp_path, env={**slurm, "PATH": path},
    )  # fmt: skip
    logs = "".join(log.read_text() for log in tmp_path.glob("slurm-*.out"))
    assert submitted.returncode == 0, submitted.stderr + logs
    assert re.search(r"Submitted batch job \d+", submitted.stdout)
    assert not list(tmp_path.glob("fogbank-farm-*"))
    fogbank = REPOSITORY / ".venv" / "bin" / "fogbank"
    alone = run(fogbank, "render", str(SCENE), *OPTIONS, "-o", "alone.exr", cwd=tmp_path)
    assert alone.returncode == 0, alone.stderr
    assert np.array_equal(image_error.read(tmp_path / "farm.exr"), image_error.read(tmp_path / "alone.exr"))


def test_workers_that_dask_asks_slurm_for(slurm: dict[str, str], tmp_path: Path) -> None:
    """`--slurm FILE`: dask-jobqueue submits the workers, and takes them back when the picture is there."""
    (tmp_path / "slurm.yaml").write_text("cores: 1\nmemory: 1GiB\nwalltime: '00:10:00'\ninterface: lo\n")
    fogbank = REPOSITORY / ".venv" / "bin" / "fogbank"
    farmed = run(
        fogbank, "farm", "render", str(SCENE), *OPTIONS, "-o", "farm.exr", "--slurm", "slurm.yaml", "--workers", "2",
        "--json", cwd=tmp_path, env={**slurm, "XDG_CACHE_HOME": str(tmp_path / "cache")},
    )  # fmt: skip
    logs = "".join(log.read_text() for log in tmp_path.glob("slurm-*.out"))
    assert farmed.returncode == 0, farmed.stderr + logs
    told = [json.loads(line) for line in farmed.stdout.splitlines()]
    assert next(event for event in told if event["event"] == "cluster")["scheduler"].startswith("tls://")
    assert next(event for event in told if event["event"] == "farm")["kinds"]["tile"]["tasks"] > 0
    end = time.monotonic() + PATIENCE_SECONDS
    while run(tool("squeue"), "--noheader", env=slurm).stdout.strip():
        assert time.monotonic() < end, "jobs of workers are left"
        time.sleep(0.5)
    alone = run(fogbank, "render", str(SCENE), *OPTIONS, "-o", "alone.exr", cwd=tmp_path)
    assert alone.returncode == 0, alone.stderr
    assert np.array_equal(image_error.read(tmp_path / "farm.exr"), image_error.read(tmp_path / "alone.exr"))
