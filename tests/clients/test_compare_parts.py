"""Parts of a comparison: scenes as every method gets them, methods by name, processes that fail."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fogbank import InvalidArgumentError, InvalidSceneError
from fogbank.comparison import methods, scene_text
from fogbank.comparison.command_worker import CommandWorker
from fogbank.comparison.engine import Engine, EngineError
from fogbank.comparison.worker import Render, Start

SCENE = """<scene version="3.0.0">
  <default name="width" value="40"/>
  <default name="mesh" value="meshes/a.ply"/>
  <integrator type="volpath"><integer name="rr_depth" value="8"/></integrator>
  <sensor type="perspective">
    <film type="hdrfilm">
      <integer name="width" value="$width"/>
      <integer name="height" value="30"/><integer name="crop_width" value="3"/>
      <rfilter type="gaussian"><float name="stddev" value="1"/></rfilter>
    </film>
  </sensor>
  <shape type="ply"><string name="filename" value="$mesh"/></shape>
</scene>
"""


def film(text: str) -> dict[str | None, str | None]:
    """What the film is told."""
    found = ElementTree.fromstring(text).find(".//film")
    assert found is not None
    return {child.get("name", child.tag): child.get("value", child.get("type")) for child in found}


def test_film_is_prepared_and_lines_stay() -> None:
    """Size and filter are replaced, the crop window goes; also in a film that says nothing."""
    prepared = scene_text.prepare_text(SCENE, (8, 6), {"mesh": 'b "&".ply'})
    assert film(prepared) == {"width": "8", "height": "6", "rfilter": "box"}
    assert len(prepared.splitlines()) == len(SCENE.splitlines())
    default = ElementTree.fromstring(prepared).find("./default[@name='mesh']")
    assert default is not None
    assert default.get("value") == 'b "&".ply'
    assert film(scene_text.prepare_text('<scene><film type="hdrfilm"/></scene>', (8, 6), {}))["rfilter"] == "box"
    with pytest.raises(InvalidSceneError, match="film"):
        scene_text.prepare_text("<scene/>", (8, 6), {})
    with pytest.raises(InvalidSceneError, match="spp"):
        scene_text.prepare_text(SCENE, (8, 6), {"spp": "4"})


def test_sizes_of_scenes(tmp_path: Path) -> None:
    """As the file says, with parameters; the missing side follows."""
    path = tmp_path / "a.xml"
    path.write_text(SCENE)
    assert scene_text.choose_size(path, {}, None) == (40, 30)
    assert scene_text.choose_size(path, {"width": "60"}, None) == (60, 30)
    assert scene_text.choose_size(path, {}, (20, None)) == (20, 15)
    assert scene_text.choose_size(path, {}, (None, 60)) == (80, 60)
    assert scene_text.film_size("<scene/>") == (768, 576)
    assert scene_text.mitsuba_rr_depth(SCENE) == 8
    assert scene_text.mitsuba_rr_depth("<scene/>") == 5


def test_files_come_along(tmp_path: Path) -> None:
    """Those that the XML names, by `$` too; none from outside its folder."""
    folder = tmp_path / "scene"
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "a.ply").write_bytes(b"mesh")
    (folder / "meshes" / "other.ply").write_bytes(b"not used")
    path = folder / "a.xml"
    path.write_text(SCENE)
    target = scene_text.prepare_scene(path, tmp_path / "copy", (8, 6), {})
    assert film(target.read_text())["width"] == "8"
    assert (tmp_path / "copy" / "meshes" / "a.ply").read_bytes() == b"mesh"
    assert not (tmp_path / "copy" / "meshes" / "other.ply").exists()
    (tmp_path / "outside.ply").write_bytes(b"mesh")
    with pytest.raises(InvalidSceneError, match="outside"):
        scene_text.prepare_scene(path, tmp_path / "copy", (8, 6), {"mesh": "../outside.ply"})
    path.write_text("<scene><film>")
    with pytest.raises(InvalidSceneError, match=r"a\.xml"):
        scene_text.prepare_scene(path, tmp_path / "copy", (8, 6), {})


def test_methods_by_name() -> None:
    """Integrators with options, Mitsuba, commands; what is wrong is named."""
    found = methods.parse_methods(
        ["cache:spheres+single-scattering=direct", "own", "path"], ["cache", "path"], ["cache"], {"own": "run {output}"}
    )
    assert found[0].settings == {"integrator": "cache", "spheres": True, "single_scattering": "direct"}
    assert [method.cached for method in found] == [True, False, False]
    assert found[1].kind == "command"
    assert "/" not in found[0].file_name
    assert ":" not in found[0].file_name
    for names, message in ((["other"], "'other' is none of"), (["cache:seed=1"], "'seed'"), (["path"] * 2, "twice")):
        with pytest.raises(InvalidArgumentError, match=message):
            methods.parse_methods(names, ["cache", "path"], ["cache"], {})


def test_what_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mitsuba stays in the table, with a note."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "pyoidn" else object())
    plain, denoised = methods.parse_methods(["mitsuba", "mitsuba+oidn"], [], [], {})
    assert plain.unavailable == ""
    assert denoised.unavailable == "pyoidn not installed"


def start(command: str, tmp_path: Path) -> dict[str, object]:
    """A start of a command."""
    return asdict(Start({"command": command}, str(tmp_path / "scene.xml"), (4, 4), 8, 5, 1))


def ended(command: str, tmp_path: Path, memory_bytes: int = 1 << 32, timeout: float = 60.0) -> EngineError:
    """How a command that doesn't work ends."""
    with Engine("command", memory_bytes) as engine, pytest.raises(EngineError) as caught:
        engine.ask("start", timeout, **start(command, tmp_path))
    return caught.value


def test_processes_that_fail(tmp_path: Path) -> None:
    """Every way to fail has its own name, and what the program said is kept."""
    failed = ended(f"{sys.executable} -c 'raise SystemExit(\"no licence\")'", tmp_path)
    assert failed.kind == "failed"
    assert "no licence" in str(failed)
    assert "render_seconds" in str(ended("echo 1", tmp_path))
    crashed = ended("sh -c 'kill -SEGV $PPID'", tmp_path)
    assert crashed.kind == "crashed"
    assert "SIGSEGV" in str(crashed)
    assert ended("sleep 60", tmp_path, timeout=2.0).kind == "timed out"
    starved = ended(f"{sys.executable} -c 'bytearray(1 << 30)'", tmp_path, memory_bytes=1 << 29)
    assert starved.kind == "out of memory"
    assert "limit 0.5 GiB" in str(starved)


def test_a_command_renders_for_a_time(tmp_path: Path) -> None:
    """Quality follows from the speed of the first run: 0.25 s each."""
    program = tmp_path / "own renderer.py"
    program.write_text(
        "import json, pathlib, sys\n"
        "output, quality = sys.argv[1:]\n"
        "pathlib.Path(output).write_text(quality)\n"
        "print('rendering')\n"
        "seconds = 0.25 * int(quality)\n"
        "print(json.dumps({'render_seconds': seconds, 'cpu_seconds': 2 * seconds, 'version': '7'}))\n"
    )
    command = f"{sys.executable} '{program}' {{output}} {{quality}}"
    output = tmp_path / "with space.exr"
    with Engine("command", 1 << 32) as engine:
        assert engine.ask("start", 60.0, **start(command, tmp_path))["versions"] == {"command": "7"}
        done = engine.ask("render", 60.0, **asdict(Render(output=str(output), seed=1, seconds=2.0)))
    assert output.read_text() == "8"
    assert (done["wall_seconds"], done["cpu_seconds"], done["samples_per_pixel"]) == (2.0, 4.0, 8)


def test_a_command_that_crashes_says_its_signal(tmp_path: Path) -> None:
    """Not a negative number."""
    start = Start({"command": "bash -c 'kill -SEGV $$'"}, str(tmp_path / "s.xml"), (4, 4), 3, 5, 1)
    with pytest.raises(RuntimeError, match=r"^bash ended with signal SIGSEGV$"):
        CommandWorker().start(start)
