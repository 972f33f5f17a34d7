"""The two-dimensional model from Python, and `fogbank reproduce gradients`."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import fogbank
import numpy as np
import pytest
from fogbank.flatland import PLAIN, read_scene
from fogbank.paths import server_binary
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.figures.gradient_errors import EXPERIMENTS, grid, measure_errors, points_by_zone
from fogbank_cli.main import run
from PIL import Image

from tests.clients.conftest import ROOT

BOX = ROOT / "scenes" / "flatland" / "box.json"

try:
    server_binary()
except fogbank.ServerStartError as absence:
    pytestmark = pytest.mark.skip(reason=f"NOT TESTED, no server: {absence}")


@pytest.fixture(scope="module")
def flatland_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[fogbank.Service]:
    """One embedded server for all tests here."""
    with fogbank.connect(data=tmp_path_factory.mktemp("data")) as service:
        yield service


def test_gradients_are_the_slopes_of_the_radiance(flatland_service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    point, step = np.array([0.63, 0.31]), 1e-4
    shifts = step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    found = flatland_service.probe_flatland(scene, point + shifts, method="exact", order="single")
    values = found.radiance
    differences = np.array([values[1] - values[2], values[3] - values[4]]) / (2 * step)
    # Second-order differences: an error of step^2 / 6 times third derivatives of a few hundred at most.
    np.testing.assert_allclose(found.gradient[0], differences, atol=1e-6)
    curvature = (values[1] + values[2] - 2 * values[0]) / step**2
    assert found.hessian[0, 0, 0] == pytest.approx(curvature, abs=1e-4)
    np.testing.assert_array_equal(found.hessian, found.hessian.transpose(0, 2, 1))
    np.testing.assert_array_equal(found.stratified_mean, found.radiance)


def test_many_points_are_sent_in_parts_and_options_arrive(flatland_service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    points = grid(scene, 40)
    options: fogbank.FlatlandOptions = {**PLAIN, "samples": 64}
    plain = flatland_service.probe_flatland(scene, points, order="single", **options)
    assert plain.radiance.shape == (1600,)
    assert plain.gradient.shape == (1600, 2)
    assert plain.hessian.shape == (1600, 2, 2)
    assert (plain.rays == 64).all()
    some = flatland_service.probe_flatland(scene, points[700:703], order="single", **options)
    np.testing.assert_array_equal(some.gradient, plain.gradient[700:703])
    corrected = flatland_service.probe_flatland(scene, points, order="single", samples=64)
    assert (corrected.rays > 64).all()
    nothing = flatland_service.probe_flatland(scene, np.empty((0, 2)))
    assert nothing.hessian.shape == (0, 2, 2)


def test_wrong_arguments_are_refused(flatland_service: fogbank.Service, tmp_path: Path) -> None:
    scene = read_scene(BOX)
    with pytest.raises(ValueError, match=r"\(3,\).*\(n, 2\)"):
        flatland_service.probe_flatland(scene, [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="method is 'magic'"):
        flatland_service.probe_flatland(scene, [[0.1, 0.2]], method="magic")  # type: ignore[arg-type]
    with pytest.raises(fogbank.InvalidArgumentError, match=r"points\[1\]"):
        flatland_service.probe_flatland(scene, [[0.1, 0.2], [0.1, 7]])
    path = tmp_path / "scene.json"
    path.write_text('{"segmets": []}')
    with pytest.raises(fogbank.InvalidSceneError, match=r"scene\.json: .*segmets"):
        read_scene(path)


def test_zones_of_the_box_are_where_geometry_puts_them(flatland_service: fogbank.Service) -> None:
    points, zones = points_by_zone(flatland_service, read_scene(BOX), 24)
    above = points[:, 1] > 0.55
    assert (zones[above] == 0).all()
    # The umbra lies left of the line from the light's left end past the occluder's right one, and right of the other.
    inside = (
        ~above & (points[:, 0] < 0.5 - (0.55 - points[:, 1]) * 0.5) & (points[:, 0] > 0.1 - (0.55 - points[:, 1]) * 0.5)
    )
    assert ((zones == 2) == inside).all()
    assert {0, 1, 2} == set(zones.tolist())


def test_the_table_has_the_figures_of_the_method(flatland_service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    table = measure_errors(flatland_service, scene, EXPERIMENTS["single"], 48, 256)
    rows = {(row.samples, row.method): row.zones for row in table}
    unaware = rows[256, "unaware"]["penumbra"]
    assert unaware.angle == pytest.approx(60, abs=8)
    assert unaware.gradient == pytest.approx(0.91, abs=0.04)
    plain = rows[256, "aware"]["penumbra"]
    # Over 12 seeds: 2.99 +- 0.27 %.
    assert plain.gradient is not None and plain.gradient < 0.04
    for zone in ("lit", "penumbra"):
        best = rows[256, "aware, bisection, sliding, mean rule"][zone]
        assert best.gradient is not None and best.gradient < 0.002
        assert best.hessian is not None and best.hessian < 0.002
    assert all(zones["umbra"].largest == 0 for zones in rows.values())


@pytest.mark.parametrize("order", ["single", "multiple"])
def test_the_command_writes_picture_and_table(order: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sizes = ["--resolution", "8", "--samples", "16", "--table-resolution", "8", "--table-samples", "64"]
    folder = tmp_path / "new" / "out"
    arguments = [
        "--data",
        str(tmp_path / "data"),
        "reproduce",
        "gradients",
        "--order",
        order,
        "-o",
        str(folder),
        *sizes,
    ]
    assert run(arguments) == ExitCode.OK
    with Image.open(folder / f"gradients_{order}.png") as picture:
        assert min(picture.size) > 500
    with (folder / f"gradients_{order}.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 3 * len(EXPERIMENTS[order].variants)
    printed = capsys.readouterr().out
    assert "| 64 | unaware |" in printed
    assert run([*arguments, "--json"]) == ExitCode.OK
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [event["event"] for event in events].count("errors") == len(EXPERIMENTS[order].variants)
    assert events[-1]["event"] == "done"


def test_without_matplotlib_the_command_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "fogbank_cli.figures.gradient_picture", None)
    assert run(["reproduce", "gradients", "-o", str(tmp_path)]) == ExitCode.USAGE
    assert "fogbank[figures]" in capsys.readouterr().err


def test_a_missing_scene_is_a_local_file(tmp_path: Path) -> None:
    arguments = ["reproduce", "gradients", "-o", str(tmp_path), "--scene", str(tmp_path / "none.json")]
    assert run(arguments) == ExitCode.LOCAL_FILE
