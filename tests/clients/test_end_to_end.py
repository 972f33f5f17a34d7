"""The client with the real server: what a user does, and what the network does to it."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import fogbank
import numpy as np
import numpy.typing as npt
import psutil
import pytest
from fogbank.channel import CHANNEL_OPTIONS
from fogbank.embedded import EmbeddedServer
from fogbank.image import Image
from fogbank.paths import server_binary
from fogbank.probe import ProbeOptions
from fogbank.probe_stream import CHUNK_POINTS
from fogbank_cli.exit_codes import ExitCode

from tests.clients.conftest import ROOT
from tests.clients.cutting_proxy import CuttingProxy
from tests.clients.test_jobs import assemble

SHAFTS = ROOT / "scenes" / "shafts" / "shafts.xml"
PENUMBRA = ROOT / "scenes" / "penumbra" / "penumbra.xml"
SLAB = ROOT / "scenes" / "analytic" / "absorbing_slab.xml"

# Small enough for seconds, large enough for several tiles and passes.
SIZE = (72, 40)

try:
    server_binary()
except fogbank.ServerStartError as absence:
    pytestmark = pytest.mark.skip(reason=f"NOT TESTED, no server: {absence}")


@pytest.fixture(scope="module")
def module_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[fogbank.Service]:
    """One embedded server for the tests that leave it as it is."""
    with fogbank.connect(data=tmp_path_factory.mktemp("data")) as service:
        yield service


@pytest.fixture(scope="module")
def shafts(module_service: fogbank.Service) -> fogbank.Scene:
    """A scene with meshes, lights and fog."""
    return module_service.load(SHAFTS)


@contextlib.contextmanager
def served(data: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A server on a TCP port, started by `fogbank serve`."""
    port_file = data.with_suffix(".port")
    port_file.unlink(missing_ok=True)
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from fogbank_cli.main import main; main()", "serve", "--listen", "127.0.0.1:0"),
            *("--data", str(data), "--port-file", str(port_file), *arguments),
        ]
    )
    try:
        while not port_file.exists():
            assert process.poll() is None
        yield process, int(port_file.read_text().strip().rpartition(":")[2])
    finally:
        process.terminate()
        process.wait()


def film(job: fogbank.Job) -> npt.NDArray[np.float32]:
    """What the job's tiles amount to."""
    return assemble(job, fogbank.Window(0, 0, *SIZE))


def test_what_a_user_does(module_service: fogbank.Service, tmp_path: Path) -> None:
    scene = module_service.load(SHAFTS)
    assert scene.statistics.triangles > 0
    assert scene.statistics.media > 0
    job = scene.render(integrator="volpath", spp=4, size=SIZE)
    tiles = list(job.tiles())
    assert all(tile.dtype == np.float32 and tile.shape[2] == 3 for tile in tiles)
    image = job.result()
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert np.all(np.isfinite(image))
    assert image.min() >= 0.0
    assert image.mean() > 0.0
    image.save(tmp_path / "out.exr")
    image.save(tmp_path / "out.png")
    np.testing.assert_array_equal(Image.from_exr((tmp_path / "out.exr").read_bytes()), image)
    statistics = job.statistics
    assert statistics is not None
    assert statistics.samples == 4 * SIZE[0] * SIZE[1]
    assert statistics.rays > statistics.samples
    assert statistics.render_seconds > 0.0
    assert statistics.render_cpu_seconds > 0.0
    assert statistics.invalid_samples == 0


def test_the_channel_options_are_those_that_the_server_asks_for(module_service: fogbank.Service) -> None:
    assert dict(CHANNEL_OPTIONS) == module_service.capabilities.channel_arguments


def test_a_slab_absorbs_as_it_must(module_service: fogbank.Service) -> None:
    sigma_t = np.array([0.1, 0.75, 2.0])
    image = module_service.load(SLAB).render(pixel_type="float", spp=16).result()
    # Rays slant by up to 0.25 degrees, so that their way through the slab of thickness 2 is longer by up to
    # 2 (1 / cos 0.25 deg - 1) = 2e-5, which sigma_t <= 2 makes a relative 4e-5.
    np.testing.assert_allclose(image.mean(axis=(0, 1)), np.exp(-2.0 * sigma_t), rtol=4e-5)


@pytest.mark.parametrize("pixel_type", ["half", "float"])
def test_tiles_add_up_to_the_image_bit_for_bit(shafts: fogbank.Scene, pixel_type: Literal["half", "float"]) -> None:
    job = shafts.render(spp=8, size=SIZE, pixel_type=pixel_type, update_interval=0.05)
    np.testing.assert_array_equal(film(job), job.result())


def test_a_late_watcher_gets_the_same_image(shafts: fogbank.Scene) -> None:
    job = shafts.render(spp=4, size=SIZE).wait()
    np.testing.assert_array_equal(film(job), job.result())


def test_the_image_depends_on_scene_and_settings_alone(shafts: fogbank.Scene) -> None:
    images = [
        np.asarray(shafts.render(spp=4, size=SIZE, **how).result())
        for how in (
            {"threads": 1, "tile_size": 16},
            {"threads": 2, "tile_size": 32, "tile_order": "scan"},
            {"tile_size": 64, "region": (50, 20, 10, 10)},
        )
    ]
    for image in images[1:]:
        np.testing.assert_array_equal(image, images[0])
    assert not np.array_equal(shafts.render(spp=4, size=SIZE, seed=1).result(), images[0])


def test_a_crop_is_the_same_part_of_the_whole(shafts: fogbank.Scene) -> None:
    window = fogbank.Window(13, 7, 30, 21)
    crop = shafts.render(integrator="volpath", spp=4, size=SIZE, crop=window, variance=True).result()
    assert crop.window == window
    assert crop.film_size == SIZE
    assert crop.variance is not None
    assert np.all(crop.variance >= 0.0)
    whole = shafts.render(integrator="volpath", spp=4, size=SIZE).result()
    inside = slice(2, -2)  # the film's filter reaches over the crop's border
    np.testing.assert_array_equal(np.asarray(crop)[inside, inside], np.asarray(whole)[window.slices][inside, inside])


def test_a_camera_can_be_replaced(shafts: fogbank.Scene) -> None:
    usual = shafts.render(spp=1, size=SIZE)
    moved = shafts.render(spp=1, size=SIZE, camera={"origin": [0, 1, 0], "target": [0, 1, 1], "fov": 50})
    assert not np.array_equal(usual.result(), moved.result())
    camera = moved.settings["camera"]
    assert isinstance(camera, dict)
    assert camera["fov"] == 50.0


def test_a_time_budget_ends_a_job_early(shafts: fogbank.Scene) -> None:
    job = shafts.render(spp=65536, size=SIZE, time_budget=0.3)
    job.result()
    statistics = job.statistics
    assert statistics is not None
    assert 0 < statistics.samples_per_pixel < 65536


def test_streams_that_nobody_reads_hold_little_memory(shafts: fogbank.Scene) -> None:
    job = shafts.render(spp=65536, size=(320, 180), pixel_type="float", update_interval=0.05)
    process = psutil.Process()
    streams = [job.tiles() for _ in range(40)]
    for stream in streams:
        next(stream)
    before = process.memory_info().rss
    reports = (event for event in job.events(tiles=False) if isinstance(event, fogbank.Progress))
    for _ in range(8):
        next(reports)
    growth = process.memory_info().rss - before
    # The windows of 40 streams of 64 KiB are 2.5 MiB; with gRPC's own settings each of the 0.7 MB updates of the
    # image would pile up 40 times over.
    assert growth < 32 * 2**20
    for stream in streams:
        next(stream)
    job.cancel()
    job.wait()


def test_a_cancelled_job_ends_for_all_its_watchers(module_service: fogbank.Service, shafts: fogbank.Scene) -> None:
    job = shafts.render(spp=65536, size=SIZE)
    next(job.tiles())
    module_service.job(job.name).cancel()
    with pytest.raises(fogbank.JobCancelledError):
        job.result()


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"integrator": "magic"}, "integrator"),
        ({"spp": 0}, "samples_per_pixel"),
        ({"size": (0, 10)}, "width"),
        ({"size": (100_000, 10)}, "width"),
        ({"crop": (0, 0, 1000, 1)}, "crop"),
        ({"tile_size": 0}, "tile_size"),
        ({"tile_size": 100_000}, "tile_size"),
        ({"camera": np.zeros((4, 4))}, "camera"),
        ({"time_budget": -1.0}, "time_budget_seconds"),
    ],
)
def test_settings_out_of_range_are_refused_by_field(
    shafts: fogbank.Scene, options: dict[str, object], field: str
) -> None:
    with pytest.raises(fogbank.InvalidArgumentError) as caught:
        shafts.render(**{"size": SIZE, **options})  # type: ignore[arg-type]
    assert caught.value.reason == "INVALID_SETTINGS"
    assert caught.value.metadata["field"].startswith(f"settings.{field}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<scene version='3.0.0'>\n<shape", r"^bad\.xml:2"),
        ("<scene version='3.0.0'>\n<shape type='torus'/></scene>", r"^bad\.xml:2: <shape type=.torus.*"),
        (
            "<scene version='3.0.0'>\n<shape type='ply'><string name='filename' value='none.ply'/></shape></scene>",
            r"^bad\.xml:2: .*none\.ply",
        ),
        (
            "<scene version='3.0.0'>\n<shape type='ply'><string name='filename' value='../x.ply'/></shape></scene>",
            r"^bad\.xml:2: (.|\n)*--root",
        ),
    ],
)
def test_a_bad_scene_is_refused_with_file_and_line(
    module_service: fogbank.Service, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(fogbank.InvalidSceneError, match=message):
        module_service.load(tmp_path / "bad.xml")


def test_a_network_that_breaks_again_and_again_costs_nothing_but_time(tmp_path: Path) -> None:
    scene_folder = tmp_path / "scene"
    scene_folder.mkdir()
    # A mesh that no lossless link could shrink, of 4 MiB: the reader ignores the comment lines that fill it.
    source = random.Random(1)
    comments = "\n".join(f"# {source.getrandbits(512):0128x}" for _ in range(32_000))
    triangle = "v 0 0 5\nv 1 0 5\nv 0 1 5\nf 1 2 3\n"
    (scene_folder / "mesh.obj").write_text(f"{comments}\n{triangle}")
    (scene_folder / "scene.xml").write_text(
        '<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/><emitter type="constant"/>'
        '<shape type="obj"><string name="filename" value="mesh.obj"/></shape></scene>'
    )
    with served(tmp_path / "data") as (_, port), contextlib.closing(CuttingProxy(port)) as proxy:
        proxy.cut_after_bytes, proxy.most_cuts = 400_000, 50
        policy = fogbank.RetryPolicy(attempts=60, longest_delay_seconds=0.02)
        with fogbank.connect(f"127.0.0.1:{proxy.port}", retry_policy=policy) as service:
            scene = service.load(scene_folder / "scene.xml")
            # 4 MiB in pieces of less than 400 kB.
            assert proxy.cuts >= 10
            proxy.cut_after_bytes, proxy.most_cuts, proxy.cuts = 30_000, 20, 0
            job = scene.render(spp=64, size=SIZE, tile_size=16, update_interval=0.05, pixel_type="float")
            seen = film(job)
            image = job.result()
            assert proxy.cuts > 0
        with fogbank.connect(f"127.0.0.1:{port}") as direct:
            undisturbed = direct.job(job.name).result()
    np.testing.assert_array_equal(seen, image)
    assert image.exr == undisturbed.exr


def test_jobs_and_scenes_outlive_the_server(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with served(data) as (process, port):
        with fogbank.connect(f"127.0.0.1:{port}") as service:
            scene = service.load(SLAB)
            job = scene.render(spp=2)
            before = job.result()
        process.kill()
    with served(data) as (_, port), fogbank.connect(f"127.0.0.1:{port}") as service:
        assert service.job(job.name).state is fogbank.JobState.SUCCEEDED
        assert service.job(job.name).result().exr == before.exr
        again = service.scene(scene.name).render(spp=2).result()
        np.testing.assert_array_equal(again, before)


def test_a_job_goes_on_with_the_next_server_and_its_watcher_with_it(tmp_path: Path) -> None:
    # More patient than the server is slow to come back.
    policy = fogbank.RetryPolicy(attempts=1000, longest_delay_seconds=0.2)
    with served(tmp_path / "data") as (process, port):
        service = fogbank.connect(f"127.0.0.1:{port}", retry_policy=policy)
        job = service.load(SLAB).render(spp=20000, size=(16, 16), pixel_type="float", priority="background")
        assert job.priority == "background"
        reader = iter(job.tiles())
        next(reader)
        job.pause()
        assert job.state is fogbank.JobState.PAUSED
        process.kill()
        process.wait()
    with service, served(tmp_path / "data", "--listen", f"127.0.0.1:{port}"):
        assert job.refresh().state is fogbank.JobState.PAUSED
        assert job.restarts == 1
        job.resume()
        for _ in reader:
            pass
        assert job.ended
        assert job.error is None


def test_scenes_below_the_servers_root_need_no_upload(tmp_path: Path) -> None:
    root = str(ROOT / "scenes")
    with (
        served(tmp_path / "data", "--scene-root", root) as (_, port),
        fogbank.connect(f"127.0.0.1:{port}") as service,
    ):
        scene = service.load_server_file("analytic/absorbing_slab.xml")
        assert scene.name == service.load(SLAB).name
        with pytest.raises(fogbank.InvalidSceneError):
            service.load_server_file("../README.md")


def test_two_servers_on_one_data_directory_are_refused(tmp_path: Path) -> None:
    first = EmbeddedServer(data=tmp_path)
    try:
        with pytest.raises(fogbank.ServerStartError, match=r"its log ends with:(.|\n)*in use"):
            EmbeddedServer(data=tmp_path)
    finally:
        first.stop()


def run_command(*arguments: str | Path) -> subprocess.Popen[str]:
    """Starts `fogbank` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", "from fogbank_cli.main import main; main()", *map(str, arguments)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
    )


def test_the_command_renders_with_a_server_of_its_own(tmp_path: Path) -> None:
    arguments = ("render", SHAFTS, "-o", tmp_path / "out.exr", "-o", tmp_path / "out.png", "--spp", "2", "--json")
    with run_command("--data", tmp_path / "data", *arguments, "--size", "72x") as process:
        output, _ = process.communicate()
    assert process.returncode == ExitCode.OK
    done = json.loads(output.splitlines()[-1])
    assert done["event"] == "done"
    assert done["image"] == str(tmp_path / "out.exr")
    assert done["render_seconds"] > 0
    assert done["render_cpu_seconds"] > 0
    assert done["load_seconds"] > 0
    assert done["samples"] == 2 * done["film_size"][0] * done["film_size"][1]
    assert done["rays"] > 0
    assert Image.from_exr((tmp_path / "out.exr").read_bytes()).shape[1] == 72


def penumbra_points(count: int) -> npt.NDArray[np.float64]:
    """Points of the room of scenes/penumbra."""
    return np.random.default_rng(2).uniform((-2.9, -3.1, -0.9), (2.9, 3.1, 1.9), (count, 3))


def test_probing_is_a_function_of_scene_options_and_point(module_service: fogbank.Service) -> None:
    scene = module_service.load(PENUMBRA)
    points = penumbra_points(CHUNK_POINTS + 20)
    options = ProbeOptions(samples=16, repeats=2, order="single")
    whole = scene.probe(points, **options)
    assert whole.media[whole.medium[0]] == "fog"
    one_by_one = [scene.probe(point, **options) for point in points[-3:]]
    for name, array in whole.arrays.items():
        assert np.isfinite(array).all()
        assert np.isfinite(whole.standard_error.arrays[name]).all()
        for i, result in enumerate(one_by_one):
            np.testing.assert_array_equal(result.arrays[name][0], array[len(points) - 3 + i])
    assert module_service.capabilities.limits["max_probe_chunk_points"].value == CHUNK_POINTS


def test_orders_add_up(module_service: fogbank.Service) -> None:
    scene = module_service.load(PENUMBRA)
    single, multiple, both = (
        scene.probe(penumbra_points(4), order=order, samples=256, repeats=8) for order in ("single", "multiple", "both")
    )
    error = np.sqrt(sum(result.standard_error.radiance**2 for result in (single, multiple, both)))
    # 12 differences of 8 repeats' means: 6 standard errors are exceeded with a probability below 1 %.
    assert (np.abs(single.radiance + multiple.radiance - both.radiance) < 6.0 * error).all()
    assert (multiple.radiance > 0.0).all()


def test_bad_probes_are_refused_by_name(module_service: fogbank.Service) -> None:
    scene = module_service.load(PENUMBRA)
    with pytest.raises(fogbank.InvalidArgumentError) as caught:
        scene.probe(np.array([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]), samples=16)
    assert caught.value.metadata["field"] == "points[1]"
    with pytest.raises(fogbank.InvalidArgumentError) as caught:
        scene.probe([0, 0, 0], method="magic")
    assert caught.value.metadata["field"] == "settings.method"
    assert "aware" in caught.value.message


def test_points_survive_a_network_that_breaks(tmp_path: Path) -> None:
    with served(tmp_path / "data") as (_, port), contextlib.closing(CuttingProxy(port)) as proxy:
        policy = fogbank.RetryPolicy(attempts=60, longest_delay_seconds=0.02)
        with fogbank.connect(f"127.0.0.1:{proxy.port}", retry_policy=policy) as service:
            scene = service.load(PENUMBRA)
            points = penumbra_points(20 * CHUNK_POINTS)
            options = ProbeOptions(samples=16, repeats=1, max_depth=2)
            # Results of 256 points are 170 kB.
            proxy.cut_after_bytes, proxy.most_cuts, proxy.cuts = 600_000, 4, 0
            broken = scene.probe(points, **options)
            assert proxy.cuts > 0
            proxy.cut_after_bytes = None
            whole = scene.probe(points, **options)
    for name, array in whole.arrays.items():
        np.testing.assert_array_equal(broken.arrays[name], array)


def test_the_example_for_researchers_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "clients" / "README.md").read_text().partition("### Derivatives for researchers")[2]
    code = text.partition("```python\n")[2].partition("```")[0]
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("FOGBANK_DATA", str(tmp_path / "data"))
    names: dict[str, Any] = {}
    exec(compile(code, "clients/README.md", "exec"), names)
    found = names["found"]
    with fogbank.connect(data=tmp_path / "data") as service:
        there = service.load(PENUMBRA).probe(names["x"] + names["d"], order="single", repeats=8)
    # 3.6 cm away in light that varies over decimetres: the next term of the expansion is far below the noise.
    error = np.hypot(found.standard_error.luminance[0], there.standard_error.luminance[0])
    assert abs(names["nearby"] - there.luminance[0]) < 6.0 * error
    assert (names["radii"] > 0.0).all()
    np.testing.assert_allclose(names["axes"].T @ names["axes"], np.eye(3), atol=1e-12)
    assert abs(names["ball_mean"] / names["M"] - 1.0) < 0.1
    assert names["rate"] > names["rate_error"] > 0.0


def test_the_command_probes_with_a_server_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"points": penumbra_points(5).tolist()}))
    arguments = ("probe", PENUMBRA, "--at", "-1,0,0", "--points", path, "--samples", "64", "--json")
    with run_command("--data", tmp_path / "data", *arguments) as process:
        output, _ = process.communicate()
    assert process.returncode == ExitCode.OK
    points = json.loads(output)["points"]
    assert [len(points), points[0]["position"]] == [6, [-1.0, 0.0, 0.0]]
    for point in points:
        assert point["samples"] > 0
        assert point["seconds"] > 0.0
        assert np.shape(point["gradient"]) == (3, 3)
        hessian = np.array(point["hessian"])
        np.testing.assert_array_equal(hessian, hessian.transpose(0, 2, 1))
        assert min(point["radiance"]) > 0.0
    with run_command("--data", tmp_path / "data", "plan", PENUMBRA, "--json") as process:
        output, _ = process.communicate()
    terms = {term["term"]: term["on"] for term in json.loads(output)["terms"]}
    assert terms["light grids"]
    assert not terms["environment grid"]


def test_ctrl_c_cancels_the_render(tmp_path: Path) -> None:
    arguments = ("render", SHAFTS, "-o", tmp_path / "out.exr", "--spp", "65536", "--json")
    with run_command("--data", tmp_path / "data", *arguments) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "progress":
                process.send_signal(signal.SIGINT)
                break
        rest = process.stdout.read()
    assert process.returncode == ExitCode.CANCELLED
    assert json.loads(rest.splitlines()[-1])["event"] == "error"
    assert not (tmp_path / "out.exr").exists()
