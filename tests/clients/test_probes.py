"""Probes and plans by package and command, against the fake server: shapes, streams, files, errors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import numpy.typing as npt
import pytest
from fogbank._generated.v1 import probe_pb2
from fogbank.probe import ProbeOptions, probe_settings
from fogbank.probe_stream import CHUNK_POINTS
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.main import run

from tests.clients.fake_probe import expected
from tests.clients.fake_server import FakeServer

Array = npt.NDArray[np.float64]

SHAPES = {
    "radiance": (3,),
    "gradient": (3, 3),
    "hessian": (3, 3, 3),
    "luminance": (),
    "luminance_gradient": (3,),
    "luminance_hessian": (3, 3),
}


def some_points(count: int) -> Array:
    return np.random.default_rng(3).uniform(-1.0, 1.0, (count, 3))


def check(result: fogbank.ProbeResult, points: Array) -> None:
    """Every array of a result against what the fake server computes."""
    assert len(result) == len(points)
    np.testing.assert_array_equal(result.position, points)
    for name, array in expected(points).items():
        assert array.shape == (len(points), *SHAPES[name])
        np.testing.assert_array_equal(getattr(result, name), array)
        np.testing.assert_array_equal(getattr(result.standard_error, name), 0.5 * array)


def test_every_number_is_in_its_place(scene: fogbank.Scene) -> None:
    points = some_points(2 * CHUNK_POINTS + 5)
    result = scene.probe(points)
    check(result, points)
    np.testing.assert_array_equal(result.samples, np.arange(len(points)))
    np.testing.assert_array_equal(result.medium, np.arange(len(points)) % 3 - 1)
    assert result.media == ("fog", "")
    assert (result.seconds == 0.5).all()


def test_one_point_and_none(scene: fogbank.Scene) -> None:
    check(scene.probe([1, 2, 3]), np.array([[1.0, 2.0, 3.0]]))
    nothings: tuple[npt.ArrayLike, ...] = ([], np.zeros((0, 3)))
    for nothing in nothings:
        result = scene.probe(nothing)
        assert len(result) == 0
        for name, shape in SHAPES.items():
            assert getattr(result, name).shape == (0, *shape)


@pytest.mark.parametrize("points", [[1, 2], [[1, 2]], np.zeros((2, 2, 3)), "abc", [[1, 2, "x"]], 5.0, [[1, 2, 3], [4]]])
def test_what_is_no_points_is_refused(scene: fogbank.Scene, points: npt.ArrayLike, fake: FakeServer) -> None:
    with pytest.raises(fogbank.InvalidArgumentError, match="points") as caught:
        scene.probe(points)
    assert caught.value.metadata == {"field": "points"}


def test_every_option_reaches_the_server(scene: fogbank.Scene, fake: FakeServer) -> None:
    options: ProbeOptions = {
        "method": "aware",
        "order": "multiple",
        "derivatives": "gradient",
        "samples": 64,
        "repeats": 7,
        "max_depth": -1,
        "bisect": False,
        "sliding": True,
        "corners": True,
        "seed": 9,
    }
    assert set(options) == set(ProbeOptions.__annotations__)
    scene.probe([0, 0, 0], **options)
    (header,) = fake.probe_headers
    assert header.scene == scene.name
    assert header.settings == probe_pb2.ProbeSettings(
        method="aware",
        order=probe_pb2.PROBE_ORDER_MULTIPLE,
        derivatives=probe_pb2.PROBE_DERIVATIVES_GRADIENT,
        samples=64,
        repeats=7,
        max_depth=-1,
        bisect=False,
        sliding=True,
        corners=True,
        seed=9,
    )
    assert probe_settings({"samples": None}) == probe_pb2.ProbeSettings()


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"order": "triple"}, "order"),
        ({"derivatives": 2}, "derivatives"),
        ({"samples": "many"}, "samples"),
        ({"seed": -1}, "seed"),
        ({"method": "magic"}, "method"),
    ],
)
def test_bad_options_are_named(scene: fogbank.Scene, options: dict[str, Any], field: str) -> None:
    with pytest.raises(fogbank.InvalidArgumentError, match=field) as caught:
        scene.probe([0, 0, 0], **options)
    assert caught.value.metadata["field"] == f"settings.{field}"
    with pytest.raises(TypeError, match="colour"):
        scene.probe([0, 0, 0], colour=1)  # type: ignore[call-arg]


def test_derivatives_that_were_not_asked_for_say_so(scene: fogbank.Scene) -> None:
    result = scene.probe(some_points(3), derivatives="gradient")
    assert result.gradient.shape == (3, 3, 3)
    with pytest.raises(ValueError, match="derivatives='hessian'"):
        result.luminance_hessian  # noqa: B018 - a property that raises
    value = scene.probe(some_points(3), derivatives="value")
    with pytest.raises(ValueError, match="derivatives='gradient'"):
        value.standard_error.gradient  # noqa: B018


def test_a_stream_takes_points_as_results_are_taken(scene: fogbank.Scene) -> None:
    taken = 0

    def endless() -> Iterator[Array]:
        nonlocal taken
        # One array that is used again and again, as a program that saves memory does.
        batch = np.empty((100, 3))
        while True:
            batch[:] = taken + np.arange(100)[:, None]
            taken += 100
            yield batch

    answered = 0
    stream = scene.probe_stream(endless())
    for _ in range(50):
        result = next(stream)
        points = np.repeat(np.arange(answered, answered + len(result), dtype=float)[:, None], 3, axis=1)
        # Every point is (i, i, i) with i counted over the stream.
        check(result, points)
        answered += len(result)
        assert taken <= answered + 10 * CHUNK_POINTS
    stream.close()  # type: ignore[attr-defined]


def test_a_stream_takes_single_points_too(scene: fogbank.Scene) -> None:
    points = some_points(CHUNK_POINTS + 1)
    results = list(scene.probe_stream(iter(points)))
    assert [len(result) for result in results] == [CHUNK_POINTS, 1]
    check(results[0], points[:-1])


def test_errors_of_the_points_iterable_are_the_callers(scene: fogbank.Scene) -> None:
    def broken() -> Iterator[list[float]]:
        yield [0.0, 0.0, 0.0]
        raise RuntimeError("the disk is gone")

    with pytest.raises(RuntimeError, match="the disk is gone"):
        list(scene.probe_stream(broken()))


def test_a_broken_stream_goes_on_with_the_points_that_are_left(scene: fogbank.Scene, fake: FakeServer) -> None:
    points = some_points(20 * CHUNK_POINTS)
    fake.faults.cut_probes_after = [0, 3, 1, 5]
    check(scene.probe(points), points)
    assert len(fake.probe_headers) == 5


def test_a_point_is_named_by_its_number_even_after_a_break(scene: fogbank.Scene, fake: FakeServer) -> None:
    points = some_points(20 * CHUNK_POINTS)
    bad = 19 * CHUNK_POINTS + 7
    points[bad, 0] = np.inf
    fake.faults.cut_probes_after = [3]
    with pytest.raises(fogbank.InvalidArgumentError) as caught:
        scene.probe(points)
    assert caught.value.reason == "INVALID_POINT"
    assert caught.value.metadata["field"] == f"points[{bad}]"
    assert caught.value.message == f"points[{bad}]: a coordinate is not finite"


def test_a_server_that_is_gone_ends_in_an_error(scene: fogbank.Scene, fake: FakeServer) -> None:
    fake.faults.cut_probes_after = [1] * 50
    with pytest.raises(fogbank.UnavailableError):
        scene.probe(some_points(10))


def test_the_plan(scene: fogbank.Scene) -> None:
    terms = scene.plan(order="single", max_depth=4)
    assert terms[0] == fogbank.PlanTerm("light grids", True, "PROBE_ORDER_SINGLE, max_depth 4")
    assert [term.on for term in scene.plan()] == [True, False]


# The command line


def command(address: str, *arguments: str | Path) -> int:
    return run(["--server", address, *map(str, arguments)])


def test_probe_answers_with_one_json_object(
    address: str, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = some_points(CHUNK_POINTS + 10)
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"points": points[1:].tolist()}))
    at = ",".join(map(repr, points[0].tolist()))
    assert command(address, "probe", scene_path, f"--at={at}", "--points", path, "--json") == ExitCode.OK
    answer = json.loads(capsys.readouterr().out)
    assert set(answer) == {"points"}
    assert len(answer["points"]) == len(points)
    for i in (0, 1, CHUNK_POINTS + 9):
        point = answer["points"][i]
        assert list(point) == ["position", *SHAPES, "standard_error", "samples", "seconds"]
        assert point["position"] == points[i].tolist()
        assert list(point["standard_error"]) == list(SHAPES)
        for name, array in expected(points[i : i + 1]).items():
            np.testing.assert_array_equal(point[name], array[0])
            np.testing.assert_array_equal(point["standard_error"][name], 0.5 * array[0])
        assert point["samples"] == i
        assert point["seconds"] == 0.5


def test_what_was_not_computed_is_null(address: str, scene_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("probe", scene_path, "--at", "-1,2,3", "--derivatives", "value", "--json")
    assert command(address, *arguments) == ExitCode.OK
    (point,) = json.loads(capsys.readouterr().out)["points"]
    assert point["gradient"] is None
    assert point["standard_error"]["luminance_hessian"] is None
    assert point["luminance"] == 304.0


def test_every_probe_option_reaches_the_server(address: str, scene_path: Path, fake: FakeServer) -> None:
    arguments = "--at 0,0,0 --method aware --order single --derivatives gradient --samples 32 --repeats 3 --max-depth 5"
    arguments += " --no-bisect --sliding --corners --seed 4"
    assert command(address, "probe", scene_path, *arguments.split()) == ExitCode.OK
    (header,) = fake.probe_headers
    assert {field.name for field, _ in header.settings.ListFields()} == set(header.settings.DESCRIPTOR.fields_by_name)
    assert (header.settings.samples, header.settings.repeats, header.settings.max_depth) == (32, 3, 5)
    assert not header.settings.bisect


def test_people_get_every_number_of_a_few_points(
    address: str, scene_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(address, "probe", scene_path, "--at", "1,0,0", "--at", "0,2,0") == ExitCode.OK
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "(1, 0, 0): medium -, 0 rays, 500 ms"
    assert lines[1].split() == ["radiance", "r", "g", "b", "1", "101", "201", "+-", "0.5", "50.5", "100.5"]
    second = lines.index("(0, 2, 0): medium fog, 1 rays, 500 ms")
    # Value twice, and for luminance and three channels a row of the gradient and three of the Hessian.
    assert second == 1 + 2 + 4 * 4
    assert len(lines) == 2 * second


def test_people_get_a_line_for_each_of_many_points(
    address: str, scene_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"points": [[i, 0, 0] for i in range(300)]}))
    for derivatives in ("value", "gradient", "hessian"):
        arguments = ("probe", scene_path, "--points", path, "--derivatives", derivatives)
        assert command(address, *arguments) == ExitCode.OK
        lines = capsys.readouterr().out.splitlines()
        assert len(lines) == 301
        assert lines[299].split()[:5] == ["298", "0", "0", "598", "299"]
        assert lines[299].split()[-1] == "fog"
        assert len({line.rindex(" ") for line in lines[2:301:3]}) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "line 1, column 2"),
        ("[1]", '{"points": [[x, y, z], ...]}'),
        ('{"points": 1}', '{"points": [[x, y, z], ...]}'),
        ('{"points": [], "colour": 1}', "unknown key 'colour'"),
        ('{"points": [[0, 0, 0], [1, 2]]}', "points[1]: [1, 2] is not [x, y, z]"),
        ('{"points": [[0, 0, "1"]]}', "points[0]: "),
        ('{"points": [[0, 0, true]]}', "points[0]: "),
        ('{"points": [[0, 0, NaN]]}', "points[0]: "),
        ('{"points": [[0, 0, 1e999]]}', "points[0]: "),
        ('{"points": [[0, 0, 1' + "0" * 400 + "]]}", "points[0]: "),
        ('{"points": [null]}', "points[0]: null"),
        ('{"points": []}', "no points"),
        ("\udcff", "is no text"),
    ],
)
def test_bad_files_of_points_are_named_with_their_element(
    address: str,
    scene_path: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    fake: FakeServer,
    text: str,
    message: str,
) -> None:
    path = tmp_path / "points.json"
    path.write_text(text, errors="surrogateescape")
    assert command(address, "probe", scene_path, "--points", path) == ExitCode.USAGE
    printed = capsys.readouterr().err
    assert message in printed
    assert "no points" in message or str(path) in printed
    assert not fake.blobs


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["--at", "1,2"], ExitCode.USAGE),
        (["--at", "1,2,x"], ExitCode.USAGE),
        (["--at", "1,2,nan"], ExitCode.USAGE),
        ([], ExitCode.USAGE),
        (["--at", "1,2,3", "--order", "triple"], ExitCode.USAGE),
        (["--at", "1,2,3", "--method", "magic"], ExitCode.USAGE),
        (["--points", "none.json"], ExitCode.LOCAL_FILE),
    ],
)
def test_wrong_use_of_probe(
    address: str, scene_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], status: ExitCode
) -> None:
    assert command(address, "probe", scene_path, *arguments, "--json") == status
    printed = capsys.readouterr()
    error = json.loads(printed.out)
    assert error["event"] == "error"
    assert error["exit_code"] == status


def test_warnings_of_the_loader_do_not_mix_with_results(
    address: str, scene_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(address, "probe", scene_path, "--at", "0,0,0", "--lenient", "--json") == ExitCode.OK
    printed = capsys.readouterr()
    assert len(json.loads(printed.out)["points"]) == 1
    assert printed.err == "warning: fog.xml:3: <bsdf>: replaced by diffuse\n"


def test_plan_says_what_is_on_and_why(address: str, scene_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(address, "plan", scene_path, "--order", "multiple", "--max-depth", "3") == ExitCode.OK
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "light grids  on   PROBE_ORDER_MULTIPLE, max_depth 3"
    assert lines[2] == "sphere grid  off  no surface reflects light"
    assert command(address, "plan", scene_path, "--json") == ExitCode.OK
    answer = json.loads(capsys.readouterr().out)
    assert answer["event"] == "plan"
    assert answer["terms"][1] == {"term": "sphere grid", "on": False, "reason": "no surface reflects light"}
