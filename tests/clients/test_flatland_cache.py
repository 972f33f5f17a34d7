"""The two-dimensional cache from Python, and `fogbank reproduce cache2d`."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import fogbank
import numpy as np
import pytest
from fogbank.flatland import read_scene
from fogbank.paths import server_binary
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.figures.cache2d_errors import CORRECTED, UNAWARE, VARIANTS, fill, make_picture
from fogbank_cli.main import run
from PIL import Image

from tests.clients.conftest import ROOT

BOX = ROOT / "scenes" / "flatland" / "box.json"

try:
    server_binary()
except fogbank.ServerStartError as absence:
    pytestmark = pytest.mark.skip(reason=f"NOT TESTED, no server: {absence}")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[fogbank.Service]:
    """One embedded server for all tests here."""
    with fogbank.connect(data=tmp_path_factory.mktemp("data")) as service:
        yield service


@pytest.mark.parametrize("resolution", [8, 30, 64, 128])
def test_points_ask_from_coarse_to_fine(service: fogbank.Service, resolution: int) -> None:
    picture = make_picture(service, read_scene(BOX), resolution)
    assert sorted(picture.order.tolist()) == list(range(resolution**2))
    assert 64 <= picture.pilot <= 256
    pilot = picture.points[picture.order[: picture.pilot]]
    assert len(np.unique(pilot[:, 0].round(9))) ** 2 == picture.pilot


def test_records_lie_where_points_asked_and_their_extents_keep_the_bounds(service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    picture = make_picture(service, scene, 32)
    points = picture.points[picture.order]
    cache = service.fill_flatland_cache(scene, points, 1e-4, {"maximum_radius": 0.2, "pilot": 64}, samples=64)
    assert cache.radiance.shape == (1024,)
    assert {tuple(place) for place in cache.positions} <= {tuple(point) for point in points}
    np.testing.assert_array_equal(cache.positions[:64], points[:64])
    assert (cache.semi_axes <= 0.2).all()
    # The default: 0.99 of the points' spacing.
    assert cache.semi_axes.min() == pytest.approx(0.99 / 32, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(cache.axis, axis=1), 1, rtol=1e-12)
    # An estimate and a look around for each record.
    assert cache.rays >= 2 * 64 * len(cache.positions)
    circles = service.fill_flatland_cache(scene, points, 1e-4, {"shape": "circle"}, samples=64)
    np.testing.assert_array_equal(circles.semi_axes[:, 0], circles.semi_axes[:, 1])


def test_aware_records_carry_penumbrae_and_unaware_ones_do_not(service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    picture = make_picture(service, scene, 128)
    # 0.0117 at 1026 records, 0.169 at 1222.
    aware = fill(service, scene, picture, CORRECTED, 1.6e-5, 1024).row
    unaware = fill(service, scene, picture, UNAWARE, 1.6e-5, 1024).row
    assert 900 < aware.records < 1150
    assert aware.penumbra_rmse <= 0.02
    assert unaware.records > aware.records
    assert unaware.penumbra_rmse > 5 * aware.penumbra_rmse
    assert fill(service, scene, picture, CORRECTED, 1.6e-5, 1024).row == aware


def test_wrong_arguments_are_refused(service: fogbank.Service) -> None:
    scene = read_scene(BOX)
    points = [[0.6, 0.3], [0.7, 0.3]]
    with pytest.raises(ValueError, match=r"\(2,\).*\(n, 2\)"):
        service.fill_flatland_cache(scene, [0.1, 0.2], 1e-3)
    with pytest.raises(ValueError, match="metric is 'third-order'; expected one of second-order, first-order"):
        service.fill_flatland_cache(scene, points, 1e-3, {"metric": "third-order"})  # type: ignore[arg-type]
    with pytest.raises(fogbank.InvalidArgumentError, match=r"cache\.threshold: must be positive"):
        service.fill_flatland_cache(scene, points, 0)
    with pytest.raises(fogbank.InvalidArgumentError, match=r"cache\.pilot"):
        service.fill_flatland_cache(scene, points, 1e-3, {"pilot": 3})
    with pytest.raises(fogbank.InvalidArgumentError, match="points: there is none"):
        service.fill_flatland_cache(scene, np.empty((0, 2)), 1e-3)


def test_the_command_writes_picture_and_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "out"
    arguments = ["--data", str(tmp_path / "data"), "reproduce", "cache2d", "-o", str(folder)]
    arguments += ["--resolution", "16", "--samples", "16", "--json"]
    assert run(arguments) == ExitCode.OK
    with Image.open(folder / "cache2d.png") as picture:
        assert min(picture.size) > 500
    with (folder / "cache2d.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == sum(len(variant.thresholds) for variant in VARIANTS)
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    caches = [event for event in events if event["event"] == "cache"]
    assert [event["records"] for event in caches] == [int(line["records"]) for line in lines]
    assert events[-1]["event"] == "done"
