"""The command `fogbank`: results, events, exit status."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import pytest
from fogbank._generated.v1 import render_pb2
from fogbank.image import Image
from fogbank_cli.exit_codes import DESCRIPTIONS, ExitCode
from fogbank_cli.main import run
from fogbank_cli.output import Output, duration, quantity
from fogbank_cli.watching import ProgressDisplay

from tests.clients.conftest import ROOT
from tests.clients.fake_job import ENDLESS, FAILING, PASSES, radiance
from tests.clients.fake_server import LOAD_SECONDS, FakeServer
from tests.clients.test_jobs import WHOLE

Events = Callable[..., tuple[int, list[dict[str, Any]]]]


@pytest.fixture
def events(address: str, capsys: pytest.CaptureFixture[str]) -> Events:
    """Runs a command with --json; returns its exit status and its events."""

    def run_with_json(*arguments: str | Path) -> tuple[int, list[dict[str, Any]]]:
        status = run(["--server", address, *map(str, arguments), "--json"])
        return status, [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return run_with_json


def kinds(events: list[dict[str, Any]]) -> list[str]:
    """What happened, without repetitions in a row."""
    found: list[str] = []
    for event in events:
        if not found or found[-1] != event["event"]:
            found.append(event["event"])
    return found


def test_render_writes_every_image_that_is_asked_for(events: Events, scene_path: Path, tmp_path: Path) -> None:
    exr, png = tmp_path / "out.exr", tmp_path / "out.png"
    status, printed = events("render", scene_path, "-o", exr, "-o", png, "--spp", "8", "--integrator", "volpath")
    assert status == ExitCode.OK
    np.testing.assert_array_equal(Image.from_exr(exr.read_bytes()), radiance(WHOLE, PASSES - 1))
    assert png.read_bytes().startswith(b"\x89PNG")
    assert kinds(printed)[:4] == ["server", "uploaded", "scene", "job"]
    done = printed[-1]
    assert done["event"] == "done"
    assert done["image"] == str(exr)
    assert done["images"] == [str(exr), str(png)]
    assert done["load_seconds"] == LOAD_SECONDS
    assert done["render_seconds"] == 0.5
    assert done["render_cpu_seconds"] == 0.9
    assert done["samples"] == 8 * 40 * 24
    assert done["samples_per_pixel"] == 8
    assert done["rays"] == 3000
    assert done["relative_noise"] == 0.02
    assert done["film_size"] == [40, 24]
    assert done["settings"]["integrator"] == "volpath"
    assert done["job"].startswith("jobs/")
    assert done["scene"].startswith("scenes/")


def test_progress_events_hold_what_a_bar_shows(
    events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer
) -> None:
    _, printed = events("render", scene_path, "-o", tmp_path / "out.exr")
    progress = next(event for event in printed if event["event"] == "progress")
    assert set(progress) == {"event", *fogbank.Progress.__dataclass_fields__}
    assert [event["state"] for event in printed if event["event"] == "state"][-1] == "succeeded"


def test_every_render_option_reaches_the_server(
    events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer
) -> None:
    camera = tmp_path / "camera.json"
    camera.write_text('{"origin": [0, 0, 0], "target": [0, 0, 1], "fov": 30}')
    arguments = (
        "--spp 4 --time 2.5 --seed 9 --size 64x32 --crop 1,2,30,20 --max-depth 7 --rr-depth 3 --float --variance"
    )
    arguments += (
        f" --threads 2 --tile-size 16 --tile-order scan --region 0,0,8,8 --integrator volpath --camera {camera}"
    )
    reference = tmp_path / "reference.exr"
    reference.write_bytes(b"pixels")
    arguments += (
        " --error 0.02 --records 100 --single-scattering cached --spheres --minimum-radius 0.2"
        " --aov radius,bias --epoch 3"
        f" --reference {reference}"
    )
    status, _ = events("render", scene_path, "-o", tmp_path / "out.exr", *arguments.split())
    assert status == ExitCode.OK
    (request,) = fake.create_job_requests
    settings = request.settings
    assert {field.name for field, _ in settings.ListFields()} == (
        set(settings.DESCRIPTOR.fields_by_name) - {"update_interval_seconds"}
    )
    assert (settings.width, settings.height, settings.max_depth, settings.rr_depth) == (64, 32, 7, 3)
    assert settings.camera.fov_degrees == 30.0
    assert list(settings.aovs) == [render_pb2.AOV_RADIUS, render_pb2.AOV_BIAS]
    assert fake.blobs[settings.reference_sha256] == b"pixels"


def test_parameters_and_root_reach_the_loader(
    events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer
) -> None:
    status, printed = events(
        "scene", "push", scene_path, "-D", "g=0.5", "-D", "$name=a=b", "--lenient", "--root", tmp_path
    )
    assert status == ExitCode.OK
    assert printed[-1]["main_path"] == "scene/fog.xml"
    assert printed[-1]["warnings"] == ["scene/fog.xml:3: <bsdf>: replaced by diffuse"]


def test_people_get_one_line_about_image_and_quality(
    address: str, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out.exr"
    assert run(["--server", address, "render", str(scene_path), "-o", str(path), "--lenient"]) == ExitCode.OK
    printed = capsys.readouterr()
    expected = f"{path}: 40x24, 4 spp, rendered in 0.5 s, 6 krays/s, estimated noise 2 %\n"
    assert printed.out == expected
    assert printed.err == "warning: fog.xml:3: <bsdf>: replaced by diffuse\n"


@pytest.mark.parametrize(
    ("element", "options", "expected"),
    [
        ("<broken/>", [], ExitCode.SCENE_INVALID),
        ("<grid/>", [], ExitCode.SCENE_INVALID),
        ('<shape filename="missing.ply"/>', [], ExitCode.SCENE_INVALID),
        ("", ["--integrator", "magic"], ExitCode.USAGE),
        ("", ["--integrator", FAILING], ExitCode.JOB_FAILED),
        ("", ["--spp", "1001"], ExitCode.LIMIT),
    ],
)
def test_errors_end_with_their_exit_status(
    events: Events, tmp_path: Path, element: str, options: list[str], expected: ExitCode
) -> None:
    path = tmp_path / "fog.xml"
    path.write_text(f"<scene>\n{element}\n</scene>")
    status, printed = events("render", path, "-o", tmp_path / "out.exr", *options)
    assert status == expected
    error = printed[-1]
    assert error["event"] == "error"
    assert error["exit_code"] == expected
    assert error["reason"]
    assert error["message"]
    assert not (tmp_path / "out.exr").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["render"],
        ["render", "fog.xml"],
        ["render", "fog.xml", "-o", "out.jpg"],
        ["render", "fog.xml", "-o", "nowhere/out.exr"],
        ["render", "fog.xml", "-o", "out.exr", "--size", "12"],
        ["render", "fog.xml", "-o", "out.exr", "--size", "x"],
        ["render", "fog.xml", "-o", "out.exr", "--size", "0x10"],
        ["render", "fog.xml", "-o", "out.exr", "--crop", "1,2,3"],
        ["render", "fog.xml", "-o", "out.exr", "-D", "novalue"],
        ["render", "fog.xml", "-o", "out.exr", "--watch-tev", "host:port"],
        ["render", "fog.xml", "-o", "out.exr", "--unknown"],
        ["unknown"],
        ["scene", "push", "x.xml", "--on-server", "--root", "."],
    ],
)
def test_wrong_use_is_noticed_before_anything_is_done(events: Events, fake: FakeServer, arguments: list[str]) -> None:
    # --json at the end is part of what the command has to parse, and may itself be what it does not know.
    status, _ = events(*arguments)
    assert status == ExitCode.USAGE
    assert not fake.jobs
    assert not fake.blobs


def test_an_unreachable_server_has_its_own_exit_status(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fogbank.retry.time.sleep", lambda seconds: None)
    monkeypatch.setenv("FOGBANK_SERVER", "127.0.0.1:1")
    assert run(["render", str(scene_path), "-o", str(tmp_path / "out.exr")]) == ExitCode.SERVER_UNREACHABLE
    assert capsys.readouterr().err.startswith("fogbank: error: cannot reach the server at 127.0.0.1:1")
    monkeypatch.delenv("FOGBANK_SERVER")
    monkeypatch.setenv("FOGBANK_SERVER_BINARY", str(tmp_path / "none"))
    assert run(["server", "status"]) == ExitCode.SERVER_UNREACHABLE


def test_an_image_that_cannot_be_written_has_its_own_exit_status(
    events: Events, scene_path: Path, tmp_path: Path
) -> None:
    # The one folder where not even the administrator can make files.
    status, printed = events("render", scene_path, "-o", "/proc/self/out.exr")
    assert status == ExitCode.LOCAL_FILE
    assert printed[-1]["message"].startswith("/proc/self/out.exr: ")


@pytest.mark.usefixtures("fake_binary")
def test_a_server_is_started_when_none_is_named(
    scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["--data", str(tmp_path / "data"), "render", str(scene_path), "-o", str(tmp_path / "out.exr")]) == 0
    assert (tmp_path / "data").is_dir()
    assert "out.exr: 40x24" in capsys.readouterr().out


def test_help_documents_every_exit_status(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == ExitCode.OK
    text = capsys.readouterr().out
    for code in ExitCode:
        assert f"{code.value:>3}  {DESCRIPTIONS[code]}" in text


def test_the_readme_documents_every_exit_status() -> None:
    text = (ROOT / "clients" / "README.md").read_text()
    for code in ExitCode:
        assert f"| {code.value} | {DESCRIPTIONS[code]} |\n" in text


def test_the_version_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == ExitCode.OK
    assert capsys.readouterr().out.startswith("fogbank, version ")


def test_scenes_can_be_listed_shown_and_removed_by_the_beginning_of_their_name(
    events: Events, scene_path: Path, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [events("scene", "push", scene_path, "-D", f"g={g}")[1][-1]["scene"] for g in (1, 2, 3)]
    _, listed = events("scene", "ls")
    assert [event["scene"] for event in listed] == names[::-1]
    short = names[0].removeprefix("scenes/")[:10]
    assert run(["--server", address, "scene", "show", short]) == ExitCode.OK
    assert names[0] in capsys.readouterr().out
    assert run(["--server", address, "scene", "ls"]) == ExitCode.OK
    assert short in capsys.readouterr().out
    status, deleted = events("scene", "rm", short, names[1])
    assert status == ExitCode.OK
    assert [event["scene"] for event in deleted] == names[:2]
    status, printed = events("scene", "show", short)
    assert status == ExitCode.NOT_FOUND
    assert printed[-1]["reason"] == "SCENE_NOT_FOUND"


def test_an_ambiguous_beginning_is_refused(events: Events, scene_path: Path) -> None:
    # Of 17 names two begin with the same hexadecimal digit.
    names = [events("scene", "push", scene_path, "-D", f"g={g}")[1][-1]["scene"] for g in range(17)]
    digits = [name.removeprefix("scenes/")[0] for name in names]
    shared = next(digit for digit in digits if digits.count(digit) > 1)
    status, printed = events("scene", "show", shared)
    assert status == ExitCode.USAGE
    assert "ambiguous" in printed[-1]["message"]


def test_jobs_can_be_listed_shown_and_watched(
    events: Events, scene: fogbank.Scene, tmp_path: Path, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = scene.render().wait()
    failed = scene.render(integrator=FAILING).wait()
    _, listed = events("job", "ls")
    assert [event["job"] for event in listed] == [failed.name, job.name]
    _, listed = events("job", "ls", "--state", "succeeded")
    assert [event["job"] for event in listed] == [job.name]
    assert run(["--server", address, "job", "show", failed.name]) == ExitCode.OK
    assert "the fake integrator fails [INTERNAL_ERROR]" in capsys.readouterr().out
    assert run(["--server", address, "job", "ls"]) == ExitCode.OK
    assert job.name.removeprefix("jobs/") in capsys.readouterr().out
    status, printed = events("job", "watch", job.name, "-o", tmp_path / "out.exr")
    assert status == ExitCode.OK
    assert printed[-1]["image"] == str(tmp_path / "out.exr")
    status, printed = events("job", "watch", job.name)
    assert status == ExitCode.OK
    assert printed[-1]["image"] is None
    assert events("job", "watch", failed.name)[0] == ExitCode.JOB_FAILED
    assert events("job", "show", "nosuchjob")[0] == ExitCode.NOT_FOUND


def test_a_job_can_be_cancelled(
    events: Events, scene: fogbank.Scene, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = scene.render(integrator=ENDLESS)
    status, printed = events("job", "cancel", job.name)
    assert status == ExitCode.OK
    assert printed == [{"event": "cancelled", "job": job.name, "state": "cancelled"}]
    assert run(["--server", address, "job", "cancel", job.name]) == ExitCode.OK
    assert capsys.readouterr().out == f"{job.name}: was cancelled already\n"
    assert events("job", "watch", job.name)[0] == ExitCode.CANCELLED


def test_the_server_describes_itself(events: Events, address: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed = events("server", "status")
    assert status == ExitCode.OK
    assert printed[0]["version"] == "0.0.1"
    assert printed[0]["uptime_seconds"] == 65.0
    _, printed = events("server", "capabilities")
    assert printed[0]["integrators"] == {"volpath": "path tracing in fog", "radiance-cache": "reads records"}
    assert run(["--server", address, "server", "status"]) == ExitCode.OK
    assert "up for 1 min 05 s" in capsys.readouterr().out
    assert run(["--server", address, "server", "capabilities"]) == ExitCode.OK
    assert "max_upload_chunk_bytes: 64 bytes" in capsys.readouterr().out


def test_serving_needs_a_data_directory(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["serve"]) == ExitCode.USAGE
    assert "--data" in capsys.readouterr().err


class FakeTev:
    """Takes what a tev viewer would be sent."""

    def __init__(self) -> None:
        """Listens."""
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.received = bytearray()
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        connection, _ = self._listener.accept()
        with connection:
            while data := connection.recv(65536):
                self.received += data

    def packets(self) -> list[bytes]:
        """Packets once the sender has closed: each begins with its length, 32 bits."""
        self._thread.join()
        self._listener.close()
        found = []
        while self.received:
            length = int.from_bytes(self.received[:4], "little")
            found.append(bytes(self.received[:length]))
            del self.received[:length]
        return found


def test_tiles_are_shown_in_tev(events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer) -> None:
    tev = FakeTev()
    status, _ = events("render", scene_path, "-o", tmp_path / "out.exr", "--watch-tev", f"127.0.0.1:{tev.port}")
    assert status == ExitCode.OK
    create, *updates = tev.packets()
    (request,) = fake.create_job_requests
    assert request.settings.update_interval_seconds > 0
    # Packet types of tev's protocol: 4 creates an image, 6 updates a part of it.
    assert create[4] == 4
    assert all(packet[4] == 6 for packet in updates)
    # At least the last pass of each of the six tiles.
    assert len(updates) >= 6
    assert radiance(WHOLE, PASSES - 1)[16:, 32:].tobytes() in b"".join(updates)


def test_a_missing_tev_does_not_stop_the_render(
    address: str, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out.exr"
    status = run(["--server", address, "render", str(scene_path), "-o", str(path), "--watch-tev", "127.0.0.1:1"])
    assert status == ExitCode.OK
    assert path.exists()
    assert "no tev at 127.0.0.1:1" in capsys.readouterr().err


def test_numbers_are_written_for_people() -> None:
    assert quantity(0, "rays/s") == "0 rays/s"
    assert quantity(4_213_000, "rays/s") == "4.21 Mrays/s"
    assert duration(0.5) == "0.5 s"
    assert duration(185.2) == "3 min 05 s"
    assert duration(7620) == "2 h 07 min"


def test_a_log_gets_a_line_for_each_tenth_of_a_long_render(capsys: pytest.CaptureFixture[str]) -> None:
    display = ProgressDisplay(Output())
    for step in range(101):
        display.progress(
            fogbank.Progress(
                passes_done=step // 50,
                passes_total=2,
                samples_per_pixel_done=step,
                fraction=step / 100,
                rays=step,
                rays_per_second=2e6,
                elapsed_seconds=0.1 * step,
                eta_seconds=10.0 - 0.1 * step,
                phase="rendering",
                records_reused=0,
                records_new=0,
                epoch=0,
                estimated_error=None,
                noise=None,
                bias=None,
                true_error=None,
                paused=False,
            )
        )
    # The first five seconds pass in silence: a short render needs no log.
    assert capsys.readouterr().err.splitlines() == [
        f"{percent} %: pass {percent // 50}/2, {percent} spp, 2 Mrays/s, {10 - percent / 10:.3g} s left"
        for percent in range(50, 101, 10)
    ]
