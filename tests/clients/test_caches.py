"""Caches: filling, files, upkeep, pictures, and jobs that use them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import pytest
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.main import run
from PIL import Image as PillowImage

from tests.clients.fake_caches import CACHE, CAMERA_RECORDS, PLAN_SIZE, file_of
from tests.clients.fake_job import CACHED, PASSES
from tests.clients.fake_server import FakeServer

CAMERAS = [{"origin": [0, 0, z], "target": [0, 0, 5]} for z in range(3)]

Events = Callable[..., tuple[int, list[dict[str, Any]]]]


@pytest.fixture
def events(address: str, capsys: pytest.CaptureFixture[str]) -> Events:
    """Runs a command with --json; returns its exit status and its events."""

    def run_with_json(*arguments: str | Path | int) -> tuple[int, list[dict[str, Any]]]:
        status = run(["--server", address, *map(str, arguments), "--json"])
        return status, [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return run_with_json


@pytest.fixture
def path_file(tmp_path: Path) -> Path:
    """Keyframes of a camera path."""
    path = tmp_path / "path.json"
    path.write_text(json.dumps(CAMERAS))
    return path


def test_a_fill_reports_every_step_and_names_its_epoch(scene: fogbank.Scene, fake: FakeServer) -> None:
    reports: list[fogbank.FillProgress] = []
    last = scene.cache.fill(CAMERAS, on_progress=reports.append, integrator=CACHED, error=0.02)
    assert reports[-1] == last
    assert [report.cameras_done for report in reports] == [0, 1, 2, 3]
    assert last.done
    assert (last.records_reused, last.records_new, last.epoch) == (0, 3 * CAMERA_RECORDS, 3)
    (request,) = fake.caches.fill_requests
    assert request.scene == scene.name
    assert request.settings.error == 0.02
    assert len(request.cameras) == 3
    again = scene.cache.fill(CAMERAS[:1])
    assert (again.records_reused, again.records_new) == (3 * CAMERA_RECORDS, 0)


def test_a_fill_goes_on_after_a_broken_connection(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.caches.cut_fills_after = [2, 1]
    assert scene.cache.fill(CAMERAS).records_reused > 0
    assert len(fake.caches.records) == 3 * CAMERA_RECORDS


def test_a_cache_says_what_it_holds(service: fogbank.Service, scene: fogbank.Scene) -> None:
    with pytest.raises(fogbank.NotFoundError, match="there is no caches/"):
        scene.cache.show()
    scene.cache.fill(CAMERAS)
    shown = scene.cache.show()
    assert shown.records == 3 * CAMERA_RECORDS
    assert [component.quantity for component in shown.components] == ["rest"]
    assert [cache.name for cache in service.caches()] == [CACHE]
    assert service.cache(CACHE).statistics.records == 3 * CAMERA_RECORDS
    assert scene.cache.verify() == fogbank.VerifyReport(records=30, segments=1, damaged_segments=0, bytes=1000)
    scene.cache.delete()
    with pytest.raises(fogbank.NotFoundError):
        service.cache(CACHE).show()


def test_export_and_import_are_whole_despite_broken_streams(
    service: fogbank.Service, scene: fogbank.Scene, fake: FakeServer, tmp_path: Path
) -> None:
    scene.cache.fill(CAMERAS)
    fake.caches.cut_exports_after = [3, 1, 0]
    scene.cache.export(tmp_path / "a.cache")
    assert (tmp_path / "a.cache").read_bytes() == fake.caches.export()
    fake.caches.records.clear()
    report = service.import_cache(tmp_path / "a.cache")
    assert (report.records_new, report.cache.statistics.records) == (30, 30)
    assert scene.cache.import_(tmp_path / "a.cache").records_new == 0


def test_files_that_are_no_caches_are_refused(service: fogbank.Service, tmp_path: Path) -> None:
    (tmp_path / "a.cache").write_text("something else")
    with pytest.raises(fogbank.InvalidArgumentError, match="not a cache file"):
        service.import_cache(tmp_path / "a.cache")
    with pytest.raises(FileNotFoundError):
        service.import_cache(tmp_path / "missing")


def test_a_merge_is_the_union_in_any_order(service: fogbank.Service, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(file_of({"1", "2"}))
    (tmp_path / "b").write_bytes(file_of({"2", "3"}))
    service.merge_caches([tmp_path / "a", tmp_path / "b"], tmp_path / "ab")
    service.merge_caches([tmp_path / "b", tmp_path / "a"], tmp_path / "ba")
    assert (tmp_path / "ab").read_bytes() == (tmp_path / "ba").read_bytes() == file_of({"1", "2", "3"})


def test_jobs_say_what_the_cache_gave_them(scene: fogbank.Scene) -> None:
    job = scene.render(integrator=CACHED)
    job.wait()
    statistics = job.statistics
    assert statistics is not None
    assert (statistics.cache, statistics.records_reused, statistics.records_new, statistics.epoch) == (CACHE, 30, 12, 3)
    assert (statistics.estimated_error, statistics.noise, statistics.bias) == (0.05, 0.04, 0.03)
    assert statistics.true_error == fogbank.TrueError(0.001, 0.01, 0.07)
    assert len(statistics.history) == PASSES
    assert statistics.history[0].noise is None
    assert job.progress.records_new == 12
    assert job.progress.estimated_error == 0.05


def test_render_prints_reused_and_new_records(
    events: Events, address: str, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["render", scene_path, "-o", tmp_path / "a.exr", "--integrator", CACHED]
    status, printed = events(*arguments)
    assert status == ExitCode.OK
    done = printed[-1]
    assert (done["records_reused"], done["records_new"], done["epoch"]) == (30, 12, 3)
    assert done["estimated_error"] == 0.05
    assert done["true_error"] == {"relative_mse": 0.001, "median": 0.01, "percentile_99": 0.07}
    assert len(done["history"]) == PASSES
    assert any(event["event"] == "progress" and event["records_new"] == 12 for event in printed)
    run(["--server", address, *map(str, arguments)])
    line = capsys.readouterr().out.splitlines()[-1]
    assert "estimated error 5 % (noise 4 %, cache 3 %)" in line
    assert "true error: median 1 %, 99th percentile 7 %" in line
    assert "30 records reused, 12 new" in line


def test_a_sweep_fills_first_and_renders_at_that_epoch(
    events: Events, scene_path: Path, path_file: Path, tmp_path: Path, fake: FakeServer
) -> None:
    pattern = tmp_path / "frames" / "%03d.exr"
    arguments = ("sweep", scene_path, "--cameras", path_file, "--frames", 5, "-o", pattern, "--integrator", CACHED)
    status, printed = events(*arguments)
    assert status == ExitCode.OK
    (fill,) = fake.caches.fill_requests
    assert len(fill.cameras) == 5
    requests = fake.create_job_requests
    assert [request.settings.camera for request in requests] == list(fill.cameras)
    assert {request.settings.epoch for request in requests} == {fake.caches.epoch}
    assert sorted(path.name for path in pattern.parent.iterdir()) == [f"{frame:03d}.exr" for frame in range(5)]
    frames = [event for event in printed if event["event"] == "frame"]
    assert [event["frame"] for event in frames] == list(range(5))
    done = printed[-1]
    assert (done["frames"], done["rendered"], done["skipped"]) == (5, 5, 0)
    assert done["records_new"] == 5 * CAMERA_RECORDS + 5 * 12

    (pattern.parent / "003.exr").unlink()
    _, printed = events(*arguments, "--resume")
    assert [event["frame"] for event in printed if event["event"] == "frame"] == [3]
    assert printed[-1]["skipped"] == 4


def test_a_sweep_can_fill_ahead(
    events: Events, scene_path: Path, path_file: Path, tmp_path: Path, fake: FakeServer
) -> None:
    pattern = tmp_path / "%d.exr"
    arguments = ("sweep", scene_path, "--cameras", path_file, "--frames", 3, "-o", pattern, "--integrator", CACHED)
    _, printed = events(*arguments, "--fill", "ahead", "--in-flight", 2)
    fills = fake.caches.fill_requests
    assert [len(fill.cameras) for fill in fills] == [1, 1, 1]
    assert [request.settings.camera for request in fake.create_job_requests] == [fill.cameras[0] for fill in fills]
    assert all(request.settings.HasField("epoch") for request in fake.create_job_requests)
    kinds = [event["event"] for event in printed if event["event"] in ("job", "frame") or event.get("done")]
    assert kinds == ["fill", "job", "fill", "job", "frame", "fill", "job", "frame", "frame"]

    # The last frame reads what it would have read without an interruption.
    (tmp_path / "2.exr").unlink()
    events(*arguments, "--fill", "ahead", "--resume")
    assert len(fills) == 6
    assert len(fake.create_job_requests) == 4


@pytest.mark.parametrize("fill", ["first", "ahead"])
def test_the_number_of_records_is_the_fills_affair(
    events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer, fill: str
) -> None:
    pattern = tmp_path / "%d.exr"
    arguments = ("sweep", scene_path, "--orbit", 2, "-o", pattern, "--integrator", CACHED)
    status, _ = events(*arguments, "--fill", fill, "--records", 1000)
    assert status == ExitCode.OK
    assert fake.caches.fill_requests[0].settings.records == 1000
    # The server refuses it of jobs that only read.
    assert not any(request.settings.HasField("records") for request in fake.create_job_requests)


def test_a_sweep_without_a_cache_only_renders(
    events: Events, scene_path: Path, tmp_path: Path, fake: FakeServer
) -> None:
    status, printed = events("sweep", scene_path, "--orbit", 4, "-o", tmp_path / "%d.png")
    assert status == ExitCode.OK
    assert not fake.caches.fill_requests
    assert printed[-1]["rendered"] == 4
    positions = [
        np.array(request.settings.camera.to_world).reshape(4, 4)[:3, 3] for request in fake.create_job_requests
    ]
    np.testing.assert_allclose(positions[0], [0, 0, -5])
    # A quarter of the way round the scene's centre each time.
    np.testing.assert_allclose(positions[2], [0, 0, 5], atol=1e-12)
    np.testing.assert_allclose(positions[1] + positions[3], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "frame.exr", "--orbit", "3"], "does not number the frames"),
        (["-o", "%d.tiff", "--orbit", "3"], "must end in .exr or .png"),
        (["-o", "%d.exr"], "give either --cameras or --orbit"),
        (["-o", "%d.exr", "--orbit", "3", "--cameras", "p.json"], "give either --cameras or --orbit"),
        (["-o", "%d.exr", "--orbit", "3", "--frames", "4"], "--frames belongs to --cameras"),
        (["-o", "%d.exr", "--cameras", "p.json", "--degrees", "4"], "--target and --degrees belong to --orbit"),
        (["-o", "%d.exr", "--cameras", "missing.json"], "cannot read missing.json"),
    ],
)
def test_a_wrong_sweep_says_what_is_wrong(events: Events, scene_path: Path, arguments: list[str], message: str) -> None:
    status, printed = events("sweep", scene_path, *arguments)
    assert status == ExitCode.USAGE
    assert message in printed[-1]["message"]


def test_cache_commands(events: Events, scene_path: Path, path_file: Path, tmp_path: Path, fake: FakeServer) -> None:
    status, printed = events("cache", "fill", scene_path, "--cameras", path_file, "--integrator", CACHED)
    assert status == ExitCode.OK
    assert printed[-1]["records_new"] == 30
    assert events("cache", "ls")[1][0]["records"] == 30
    for name in (CACHE, "ccc", scene_path):
        assert events("cache", "show", name)[1][-1]["components"][0]["quantity"] == "rest"
    file = tmp_path / "c.cache"
    assert events("cache", "export", "ccc", file)[1][-1]["bytes"] == file.stat().st_size
    assert events("cache", "import", file)[1][-1]["records_new"] == 0
    assert events("cache", "merge", file, file, "-o", tmp_path / "d.cache")[0] == ExitCode.OK
    assert (tmp_path / "d.cache").read_bytes() == file.read_bytes()
    assert events("cache", "verify")[1][-1]["damaged_segments"] == 0
    assert events("cache", "gc", "--budget", "1K")[1][-1]["removed"] == []
    assert events("cache", "gc", "--budget", "10")[1][-1]["removed"] == [CACHE]
    assert events("cache", "rm", "ccc")[0] == ExitCode.NOT_FOUND


def test_the_view_shows_plan_and_records(
    events: Events, scene: fogbank.Scene, scene_path: Path, tmp_path: Path, fake: FakeServer
) -> None:
    view = scene.cache.view(side=64, cut=0.5, error=0.1)
    assert view.plan.depth.shape == PLAN_SIZE[::-1]
    assert np.isinf(view.plan.depth[:, 0]).all()
    assert view.plan.solid.sum() == 1
    assert view.plan.extent == (-3.0, 3.0, 2.0, -2.0)
    (extents,) = view.records
    np.testing.assert_allclose(extents.radii, [0.5, 0.125])
    assert fake.caches.view_requests[-1].settings.error == 0.1
    status, printed = events("cache", "view", scene_path, "-o", tmp_path / "top.png", "--up", "y")
    assert status == ExitCode.OK
    assert printed[-1]["records"] == 2
    assert fake.caches.view_requests[-1].up_axis == 1
    with PillowImage.open(tmp_path / "top.png") as picture:
        assert picture.size[0] > PLAN_SIZE[0]
    assert events("cache", "view", scene_path, "-o", tmp_path / "top.exr")[0] == ExitCode.USAGE
