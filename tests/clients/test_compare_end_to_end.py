"""Comparisons and references with the real server: small pictures, short times."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import asdict
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import pandas as pd
import pytest
from fogbank.comparison.comparison import Comparison
from fogbank.comparison.engine import Engine
from fogbank.comparison.image_error import measure, read
from fogbank.comparison.references import halves_of, load_reference, make_reference, read_state
from fogbank.comparison.runner import ComparisonProgress
from fogbank.comparison.scene_text import prepare_scene
from fogbank.comparison.worker import Render, Start
from fogbank.paths import server_binary
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.main import run

from tests.clients.conftest import ROOT

PENUMBRA = ROOT / "scenes" / "penumbra" / "penumbra.xml"
SLAB = ROOT / "scenes" / "analytic" / "absorbing_slab.xml"
SIZE = (16, 16)
WITHOUT_CLOSING = {"meta", "img", "input", "br", "link"}

try:
    server_binary()
except fogbank.ServerStartError as absence:
    pytestmark = pytest.mark.skip(reason=f"NOT TESTED, no server: {absence}")


class Page(HTMLParser):
    """Elements that are open at the end, and what would be fetched from elsewhere."""

    def __init__(self, text: str) -> None:
        """Reads all of it."""
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []
        self.pictures = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Counts."""
        if tag not in WITHOUT_CLOSING:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href") and value:
                self.pictures += value.startswith("data:image/png;base64,")
                if not value.startswith("data:"):
                    self.outside.append(value)

    def handle_endtag(self, tag: str) -> None:
        """Closes."""
        assert self.open.pop() == tag


def compare(folder: Path, **more: Any) -> Comparison:  # noqa: ANN401 - arguments of any type
    """Path tracing and the cache, one picture each, unless told otherwise."""
    arguments: dict[str, Any] = {
        "methods": ["radiance-cache", "volpath"],
        "budgets": [0.2],
        "seeds": 1,
        "make_reference": 0.3,
        "size": SIZE,
        "threads": 1,
    }
    return fogbank.compare(PENUMBRA, folder, **arguments | more)


def test_reports_and_goes_on(tmp_path: Path) -> None:
    """Everything is there; a second time nothing is rendered again, and new methods and seeds are added."""
    steps: list[ComparisonProgress] = []
    first = compare(tmp_path, on_progress=steps.append)
    assert first.table["status"].tolist() == ["done", "done"]
    assert (first.table["cpu_seconds"] > 0).all()
    assert first.table["records"].notna().tolist() == [True, False]
    image = first.images["volpath", 0.2, 1]
    error = measure(image, first.reference.half_a, first.reference.half_b)
    assert first.table["trimmed"][1] == error.trimmed
    assert pd.read_csv(tmp_path / "results.csv")["method"].tolist() == ["radiance-cache", "volpath"]
    assert [step.fraction for step in steps] == sorted(step.fraction for step in steps)

    text = first.report.read_text()
    page = Page(text)
    assert page.open == []
    assert page.outside == []
    # Two plots, a map of each kind and method, the records from above.
    assert page.pictures >= 2 + 4 + 1
    assert not re.search(r"https?://", text)

    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    own = f"{sys.executable} -c 'raise SystemExit(5)'"
    second = compare(tmp_path, methods=["radiance-cache", "volpath", "own"], adapters={"own": own}, seeds=2)
    assert {path: path.stat().st_mtime_ns for path in files} == files
    counts = second.table.groupby(["method", "status"]).size().to_dict()
    assert counts == {("radiance-cache", "done"): 2, ("volpath", "done"): 2, ("own", "failed"): 2}
    assert "status 5" in second.report.read_text()
    np.testing.assert_array_equal(second.images["volpath", 0.2, 1], image)
    # Another seed is another picture.
    assert not np.array_equal(second.images["volpath", 0.2, 2], image)

    with pytest.raises(fogbank.InvalidArgumentError, match="another max_depth"):
        compare(tmp_path, max_depth=3)


def test_an_interruption_loses_one_picture_at_most(tmp_path: Path) -> None:
    """Ctrl-C after the first picture: the same call goes on with the second."""

    def interrupt(progress: ComparisonProgress) -> None:
        if progress.doing.startswith("volpath"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(tmp_path, on_progress=interrupt)
    (made,) = (tmp_path / "runs").glob("*.exr")
    before = made.stat().st_mtime_ns
    assert compare(tmp_path).table["status"].tolist() == ["done", "done"]
    assert made.stat().st_mtime_ns == before


def test_without_mitsuba_the_rest_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its row says what is missing."""
    monkeypatch.setattr("fogbank.comparison.methods._missing", lambda *modules: f"{modules[0]} not installed")
    found = compare(tmp_path, methods=["volpath", "mitsuba"])
    assert found.table["status"].tolist() == ["done", "not installed"]
    assert "mitsuba not installed" in found.report.read_text()


def test_mitsuba_renders_what_we_render(tmp_path: Path) -> None:
    """Size, depth and filter arrive: within the noise of its own seeds; and the denoiser takes noise away."""
    pytest.importorskip("mitsuba", reason="NOT TESTED, Mitsuba is not installed")
    pytest.importorskip("pyoidn", reason="NOT TESTED, OIDN is not installed")
    size, depth = (24, 18), 3
    scene = prepare_scene(PENUMBRA, tmp_path / "scene", size, {})
    with fogbank.connect(data=tmp_path / "data") as service:
        path = tmp_path / "r.exr"
        make_reference(service.load(scene), path, seconds=2.0, size=size, max_depth=depth)
    reference = load_reference(path)
    images, errors = [], []
    for denoise in (False, True):
        settings = {"variant": "scalar_rgb", "denoise": denoise}
        with Engine("mitsuba", 1 << 33) as engine:
            engine.ask("start", 300.0, **asdict(Start(settings, str(scene), size, depth, 5, 1)))
            for seed in range(4):
                output = tmp_path / f"{denoise}_{seed}.exr"
                done = engine.ask("render", 60.0, **asdict(Render(output=str(output), seed=seed, seconds=0.1)))
                assert (done["denoise_seconds"] > 0) == denoise
                images.append(read(output))
        found = [measure(image, reference.half_a, reference.half_b).trimmed for image in images[-4:]]
        errors.append(np.mean(found))
    # The lower half is fog without the lamp. An edge more or less of the paths would change it by 16 or 33 %.
    below = size[1] // 2
    theirs = np.mean([image[below:].mean() for image in images[:4]])
    assert theirs == pytest.approx(reference.mean[below:].mean(), rel=0.06)
    assert errors[1] < errors[0]


def test_equal_records(tmp_path: Path) -> None:
    """Methods without records say so; twice the records are asked for and made."""
    found = compare(tmp_path, equal="records", budgets=[40, 80], spp=4)
    few, _, many, path_tracing = found.table.to_dict("records")
    assert (few["budget"], many["budget"]) == (40, 80)
    assert 40 <= few["records"] < many["records"]
    assert many["samples_per_pixel"] == 4
    assert path_tracing["status"] == "not applicable"
    assert (found.records_to_error["method"] == "volpath").sum() == len(found.records_to_error) / 2
    assert found.records_to_error[found.records_to_error["method"] == "volpath"]["cost"].isna().all()
    assert Page(found.report.read_text()).open == []


def test_too_little_memory_is_a_row(tmp_path: Path) -> None:
    """96 MiB are not enough for a server; the report is written all the same."""
    found = compare(tmp_path, methods=["volpath"], memory_bytes=96 << 20)
    assert found.table["status"].tolist() != ["done"]
    assert found.table["message"][0]
    assert Page(found.report.read_text()).open == []


def test_references_go_on_and_state_their_noise(tmp_path: Path) -> None:
    """More samples have less noise; the mean is that of the halves; another scene is refused."""
    path = tmp_path / "r.exr"
    with fogbank.connect(data=tmp_path / "data") as service:
        scene = service.load(PENUMBRA)
        first = make_reference(scene, path, seconds=0.2, size=SIZE)
        assert first.residual is not None
        found = load_reference(path)
        assert found.independent
        assert found.residual == pytest.approx(first.residual, rel=1e-3)
        again = make_reference(scene, path, seconds=0.2, size=SIZE)
        assert (again.rounds, again.seconds) == (first.rounds, first.seconds)
        more = make_reference(scene, path, seconds=3.0, error=0.5 * first.residual, size=SIZE)
        assert more.residual is not None
        assert more.rounds > first.rounds
        assert more.residual <= 0.5 * first.residual or more.seconds >= 3.0
        # Noise falls with the root of the samples; of 256 pixels, with long tails, it is known to some 10 %.
        expected = first.residual * np.sqrt(first.samples_per_pixel / more.samples_per_pixel)
        assert more.residual == pytest.approx(expected, rel=0.35)
        with pytest.raises(fogbank.InvalidArgumentError, match="another scene"):
            make_reference(service.load(SLAB), path, seconds=0.2, size=SIZE)
    assert read_state(path) == more
    half_a, half_b = (read(half) for half in halves_of(path))
    assert not np.array_equal(half_a, half_b)
    np.testing.assert_allclose(read(path), (half_a + half_b) / 2, rtol=1e-6)


def test_a_reference_is_right(tmp_path: Path) -> None:
    """exp(-tau) of a slab that absorbs only: there is no noise in it, and both halves know."""
    path = tmp_path / "slab.exr"
    with fogbank.connect(data=tmp_path / "data") as service:
        make_reference(service.load(SLAB), path, seconds=0.05, size=SIZE)
    # sigma_t 2 x (0.05, 0.375, 1), thickness 2 (scenes/analytic/expect.toml), before a background of 1.
    np.testing.assert_allclose(read(path).mean(axis=(0, 1)), np.exp(-4 * np.array([0.05, 0.375, 1.0])), rtol=1e-4)


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`reference`, then `compare` with it; wrong use is said."""
    path, folder = tmp_path / "r.exr", tmp_path / "out"
    common = ("--size", "16x16", "--threads", "1")
    assert run(["reference", str(PENUMBRA), "-o", str(path), "--time", "0.2s", *common, "--json"]) == ExitCode.OK
    done = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert done["event"] == "done"
    assert done["residual"] > 0
    budget = ("--methods", "volpath", "--budgets", "0.1", "--seeds", "1", "--reference", str(path))
    assert run(["compare", str(PENUMBRA), "-o", str(folder), *budget, "--threads", "1", "--json"]) == ExitCode.OK
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert events[-1] == {
        "event": "done",
        "report": str(folder / "report.html"),
        "table": str(folder / "results.csv"),
    }
    (picture,) = [event for event in events if event["event"] == "picture"]
    assert picture["status"] == "done"
    assert picture["records"] is None
    assert run(["compare", str(PENUMBRA), "-o", str(folder), "--methods", "none"]) == ExitCode.USAGE
    assert run(["compare", str(PENUMBRA), "-o", str(folder), "--budgets", "0"]) == ExitCode.USAGE
    assert run(["--server", "localhost:1", "compare", str(PENUMBRA), "-o", str(folder)]) == ExitCode.USAGE


def test_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without its packages the error says what to install."""
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(ModuleNotFoundError, match=r"fogbank\[compare\]"):
        compare(tmp_path)
