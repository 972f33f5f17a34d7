"""`fogbank farm`: the command, and sweeps."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import fogbank
import psutil
import pytest
from fogbank_cli.main import run

from tests.farm.conftest import Record
from tests.farm.scenes import assert_same_pictures, write_scene

pytestmark = pytest.mark.farm

PICTURE = ("--integrator", "radiance-cache", "--size", "40x24", "--spp", "4", "--float")


def events(capfd: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """What `--json` printed."""
    return [json.loads(line) for line in capfd.readouterr().out.splitlines() if line.startswith("{")]


def cpu_seconds() -> float:
    """Of this process and all below it, ended ones included."""
    this = psutil.Process()
    times = this.cpu_times()
    total = times.user + times.system + times.children_user + times.children_system
    for child in this.children(recursive=True):
        try:
            spent = child.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total += spent.user + spent.system + spent.children_user + spent.children_system
    return float(total)


def test_render(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scene = str(write_scene(tmp_path / "scene"))
    alone, farmed = tmp_path / "alone.exr", tmp_path / "farm.exr"
    assert run(["--data", str(tmp_path / "a"), "render", scene, "-o", str(alone), *PICTURE]) == 0
    capfd.readouterr()
    assert (
        run(
            [
                "--data",
                str(tmp_path / "b"),
                "farm",
                "render",
                scene,
                "-o",
                str(farmed),
                "--local",
                "2",
                *PICTURE,
                "--json",
            ]
        )
        == 0
    )
    told = events(capfd)
    kinds = [event["event"] for event in told]
    assert {"cluster", "scene", "job", "progress", "done", "farm"} <= set(kinds)
    assert len(next(event["workers"] for event in told if event["event"] == "cluster")) == 2
    assert_same_pictures(fogbank.Image.from_exr(farmed.read_bytes()), fogbank.Image.from_exr(alone.read_bytes()))


@pytest.mark.parametrize(("fill", "frames"), [("first", 4), ("ahead", 60)])
def test_sweep(request: pytest.FixtureRequest, tmp_path: Path, record: Record, fill: str, frames: int) -> None:
    if frames > 4:
        request.getfixturevalue("trips_as_measured")
    scene = str(write_scene(tmp_path / "scene"))
    path = ("--orbit", str(frames), "--degrees", str(frames), "--fill", fill)
    # Frames that are next to no work: what is measured is what a farm adds.
    picture = ("--integrator", "radiance-cache", "--size", "32x20", "--spp", "2", "--error", "0.5", "--float")
    for name, command in (
        ("one at a time", ["sweep", "--threads", "1", "--in-flight", "1"]),
        ("two workers", ["farm", "sweep", "--local", "2"]),
    ):
        began, spent = time.monotonic(), cpu_seconds()
        output = str(tmp_path / name / "%04d.exr")
        assert run(["--data", str(tmp_path / f"{name}.data"), *command, scene, "-o", output, *path, *picture]) == 0
        record(f"{frames} frames, {name}", time.monotonic() - began, "s wall")
        record(f"{frames} frames, {name}", cpu_seconds() - spent, "s CPU")
    for frame in range(frames):
        assert_same_pictures(
            fogbank.Image.from_exr((tmp_path / "two workers" / f"{frame:04d}.exr").read_bytes()),
            fogbank.Image.from_exr((tmp_path / "one at a time" / f"{frame:04d}.exr").read_bytes()),
        )


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "give one of --local, --scheduler"),
        (["--local", "1", "--scheduler", "tcp://127.0.0.1:1"], "give one of --local, --scheduler"),
        (["--scheduler", "tls://127.0.0.1:1"], "certificates belong to an address that begins with tls://"),
    ],
)
def test_wrong_use(tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], text: str) -> None:
    scene = str(write_scene(tmp_path / "scene"))
    assert run(["farm", "render", scene, "-o", str(tmp_path / "a.exr"), *arguments]) == 2
    assert text in capfd.readouterr().err


@pytest.mark.parametrize("kind", ["slurm", "kubernetes"])
def test_packages_that_are_not_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    file = tmp_path / "cluster.yaml"
    file.write_text("cores: 1\n")
    scene = str(write_scene(tmp_path / "scene"))
    package = {"slurm": "dask_jobqueue", "kubernetes": "dask_kubernetes"}[kind]
    monkeypatch.setitem(sys.modules, package, None)
    assert run(["farm", "render", scene, "-o", str(tmp_path / "a.exr"), f"--{kind}", str(file)]) == 2
    assert f"{package} is not installed; it comes with pip install" in capfd.readouterr().err
