"""Open Job Description: templates, the parts that their tasks make, and a run of the whole by `openjd`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import pytest
import yaml
from fogbank import RenderOptions
from fogbank.image_join import join_images
from fogbank_cli.main import run
from openjd.model import decode_job_template

from tests.farm.scenes import RECORDS, assert_same_pictures, write_scene

_TOOLS = Path(sys.executable).parent


def template(tmp_path: Path, *arguments: str) -> dict[str, Any]:
    """What `fogbank openjd` writes, validated by the specification's own library."""
    path = tmp_path / "template.yaml"
    scene = write_scene(tmp_path / "scene")
    assert run(["--data", str(tmp_path / "data"), "openjd", str(scene), "-o", str(path), *arguments]) == 0
    written: dict[str, Any] = yaml.safe_load(path.read_text())
    decode_job_template(template=written, supported_extensions=["TASK_CHUNKING"])
    return written


def test_parts_join_to_the_whole(service: fogbank.Service, tmp_path: Path) -> None:
    scene = service.load(write_scene(tmp_path / "scene"))
    scene.cache.fill(integrator="radiance-cache", size=RECORDS["size"])
    options = RenderOptions(**{**RECORDS, "records": 0})
    whole = scene.render(**options)
    width, height = 64, 40
    parts = {}
    for top, bottom in ((0, 7), (7, 24), (24, height)):
        crop = fogbank.Window(0, top, width, bottom - top)
        parts[f"{top}.exr"] = scene.render(**RenderOptions(**{**options, "crop": crop})).result().exr
    joined = join_images(parts)
    assert_same_pictures(joined, whole.result())
    assert whole.statistics is not None
    assert whole.statistics.records_new == 0
    assert joined.film_size == (width, height)
    assert joined.window == fogbank.Window(0, 0, width, height)
    assert joined.metadata["fogbank:settings"].count("crop") == 1

    with pytest.raises(fogbank.InvalidArgumentError, match="1088 pixels uncovered, the first at 0, 7"):
        join_images({name: data for name, data in parts.items() if name != "7.exr"})
    other = (
        scene.render(**RenderOptions(**{**options, "seed": 1, "crop": fogbank.Window(0, 7, width, 17)})).result().exr
    )
    with pytest.raises(fogbank.InvalidArgumentError, match=r"other\.exr is not of the picture that .* its seed is 1"):
        join_images({**parts, "other.exr": other})
    with pytest.raises(fogbank.DataLossError):
        join_images({**parts, "damaged.exr": parts["0.exr"][:200]})


def test_template_of_one_picture(tmp_path: Path) -> None:
    written = template(tmp_path, "--integrator", "radiance-cache", "--spp", "4", "--bands", "8", "--variance")
    assert [step["name"] for step in written["steps"]] == ["Fill", "Tiles", "Assemble"]
    assert [step.get("dependencies") for step in written["steps"]] == [
        None,
        [{"dependsOn": "Fill"}],
        [{"dependsOn": "Tiles"}],
    ]
    (bands,) = written["steps"][1]["parameterSpace"]["taskParameterDefinitions"]
    assert (bands["type"], bands["range"]) == ("CHUNK[INT]", "1-8")
    arguments = written["steps"][1]["script"]["actions"]["onRun"]["args"]
    assert {"--variance", "--records", "--openjd"} <= set(arguments)
    defaults = {parameter["name"]: parameter.get("default") for parameter in written["parameterDefinitions"]}
    assert defaults == {"Scene": "scene/fog.xml", "Folder": "template", "Fogbank": "fogbank", "BandsPerTask": 4}


def test_template_of_frames_without_a_cache(tmp_path: Path) -> None:
    written = template(tmp_path, "--integrator", "volpath", "--orbit", "5", "--bands", "4")
    assert [step["name"] for step in written["steps"]] == ["Tiles", "Assemble"]
    frame, _ = written["steps"][0]["parameterSpace"]["taskParameterDefinitions"]
    assert frame == {"name": "Frame", "type": "INT", "range": "0-4"}
    assert "--records" not in written["steps"][0]["script"]["actions"]["onRun"]["args"]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--frames", "3"], "--frames belongs to --cameras"),
        (["--bands", "4", "--bands-per-task", "5"], "none may be above the next"),
        (["--bands", "1000"], "none may be above the next"),
        (["--size", "64x"], "give both sides of --size"),
        (["--error", "0.1"], "No such option"),
    ],
)
def test_what_a_template_cannot_say(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], text: str
) -> None:
    scene = write_scene(tmp_path / "scene")
    path = tmp_path / "template.yaml"
    assert run(["--data", str(tmp_path / "data"), "openjd", str(scene), "-o", str(path), *arguments]) == 2
    assert text in capfd.readouterr().err
    assert not path.exists()


@pytest.mark.farm
def test_openjd_runs_it(tmp_path: Path) -> None:
    size = ("--size", "48x32", "--integrator", "radiance-cache")
    template(tmp_path, *size, "--orbit", "2", "--degrees", "20", "--spp", "2", "--bands", "4", "--bands-per-task", "3")
    finished = subprocess.run(
        [
            *(_TOOLS / "openjd", "run", tmp_path / "template.yaml", "--step", "Assemble", "--run-dependencies"),
            *("-p", f"Fogbank={_TOOLS / 'fogbank'}"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert "openjd_progress: 100.0" in finished.stdout
    assert len(list((tmp_path / "template" / "parts").glob("*.exr"))) == 4

    pattern = tmp_path / "whole" / "%04d.exr"
    scene = tmp_path / "scene" / "fog.xml"
    path = ("--orbit", "2", "--degrees", "20")
    assert run(["--data", str(tmp_path / "d"), "cache", "fill", str(scene), *size, *path]) == 0
    whole = ["sweep", str(scene), "-o", str(pattern), *size, *path, "--spp", "2", "--records", "0"]
    assert run(["--data", str(tmp_path / "d"), *whole]) == 0
    for frame in range(2):
        joined = fogbank.Image.from_exr((tmp_path / "template" / f"{frame:04d}.exr").read_bytes())
        assert_same_pictures(joined, fogbank.Image.from_exr((tmp_path / "whole" / f"{frame:04d}.exr").read_bytes()))
        assert np.mean(np.asarray(joined)) > 0.0


@pytest.mark.farm
def test_failures_reach_the_scheduler(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["--data", str(tmp_path / "data"), "render", "absent.xml", "-o", str(tmp_path / "a.exr"), "--openjd"]) == 3
    )
    assert "openjd_fail: " in capfd.readouterr().out
