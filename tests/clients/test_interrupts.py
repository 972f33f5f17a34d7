"""Ctrl-C: once cancels the job, twice leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import fogbank
import pytest
from fogbank import JobState
from fogbank._generated.v1 import render_pb2
from fogbank_cli.exit_codes import ExitCode

from tests.clients.conftest import ROOT
from tests.clients.fake_job import ENDLESS, FakeJob
from tests.clients.fake_server import FakeServer


@contextmanager
def command(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """Runs `fogbank` in a process of its own, which can be sent signals."""
    with subprocess.Popen(
        [sys.executable, "-c", "from fogbank_cli.main import main; main()", *map(str, arguments), "--json"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        yield process


def read_until(process: subprocess.Popen[str], kind: str) -> dict[str, object]:
    """The next event of this kind."""
    assert process.stdout is not None
    for line in process.stdout:
        event: dict[str, object] = json.loads(line)
        if event["event"] == kind:
            return event
    raise AssertionError(f"the command ended without the event {kind}")


def test_one_interrupt_cancels_the_job(address: str, fake: FakeServer, scene_path: Path, tmp_path: Path) -> None:
    arguments = ("--server", address, "render", scene_path, "-o", tmp_path / "out.exr", "--integrator", ENDLESS)
    with command(*arguments) as process:
        read_until(process, "progress")
        process.send_signal(signal.SIGINT)
        read_until(process, "cancelling")
        error = read_until(process, "error")
    assert process.returncode == ExitCode.CANCELLED
    assert error["reason"] == "JOB_CANCELLED"
    assert error["exit_code"] == ExitCode.CANCELLED
    (job,) = fake.jobs.values()
    assert job.message.state == render_pb2.JOB_STATE_CANCELLED
    assert not (tmp_path / "out.exr").exists()


def test_a_second_interrupt_leaves_without_waiting(
    address: str, fake: FakeServer, scene_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A server that takes note of the wish and does nothing about it.
    monkeypatch.setattr(FakeJob, "cancel", lambda job: None)
    arguments = ("--server", address, "render", scene_path, "-o", tmp_path / "out.exr", "--integrator", ENDLESS)
    with command(*arguments) as process:
        read_until(process, "progress")
        process.send_signal(signal.SIGINT)
        read_until(process, "cancelling")
        read_until(process, "progress")
        process.send_signal(signal.SIGINT)
        error = read_until(process, "error")
    assert process.returncode == ExitCode.CANCELLED
    assert error["message"] == "interrupted"
    monkeypatch.undo()


def test_interrupting_a_watch_leaves_the_job_alone(address: str, fake: FakeServer, scene: fogbank.Scene) -> None:
    job = scene.render(integrator=ENDLESS)
    with command("--server", address, "job", "watch", job.name) as process:
        read_until(process, "progress")
        process.send_signal(signal.SIGINT)
        read_until(process, "error")
    assert process.returncode == ExitCode.CANCELLED
    assert job.refresh().state is JobState.RUNNING


def test_output_that_nobody_reads_ends_the_command_quietly(address: str, scene: fogbank.Scene) -> None:
    job = scene.render(integrator=ENDLESS)
    with command("--server", address, "job", "watch", job.name) as process:
        read_until(process, "progress")
        assert process.stdout is not None
        process.stdout.close()
        process.wait()
    assert process.returncode == ExitCode.INTERNAL
    assert job.refresh().state is JobState.RUNNING
