"""The Dockerfile's steps in a Debian of their own, and the images that come of it: `make test-deploy`.

The stage `build` is what `make build` does, from the same package list: its products are taken from this checkout.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fogbank.paths import server_binary

from tests.deploy.examples import DEPLOY, REPOSITORY, run, tool
from tests.deploy.image_root import Image, Network, bootstrap, copy_root
from tests.service.harness import PATIENCE_SECONDS

pytestmark = [pytest.mark.deployment, pytest.mark.timeout(3600)]
USER = 10001


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minimal Debian."""
    for name in ("debootstrap", "unshare", "ip", "setpriv"):
        tool(name)
    if os.geteuid() != 0:
        pytest.skip("root is needed, for chroot and namespaces")
    folder = tmp_path_factory.mktemp("base") / "root"
    bootstrap(folder)
    return folder


@pytest.fixture(scope="module")
def build(base: Path) -> Path:
    """What the stage `build` leaves."""
    folder = base.parent / "build"
    copy_root(base, folder)
    Image(folder).build("build", {}, commands=False)
    program = folder / "source" / "build" / "release" / "bin" / "fogbankd"
    program.parent.mkdir(parents=True)
    shutil.copy(server_binary(), program)
    packages = run(DEPLOY / "runtime-packages.sh", str(server_binary()))
    assert packages.returncode == 0
    (folder / "source" / "runtime-packages.txt").write_text(packages.stdout)
    return folder


@pytest.fixture(scope="module")
def server(base: Path, build: Path) -> Image:
    """The image `server`."""
    folder = base.parent / "server"
    copy_root(base, folder)
    image = Image(folder)
    image.build("server", {"build": build})
    return image


@pytest.fixture(scope="module")
def tools(server: Image, build: Path) -> Image:
    """The image `tools`."""
    python = Image(build)
    # Of the stage `build` these are all that the stage `python` needs.
    python.run("apt-get update && apt-get install --yes --no-install-recommends python3-venv")
    python.workdir = "/source"
    python.build("python", {})
    folder = server.folder.parent / "tools"
    copy_root(server.folder, folder)
    image = Image(folder, environment=dict(server.environment))
    image.build("tools", {"python": build})
    return image


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """The volume, which the images' user owns."""
    folder = tmp_path / "data"
    folder.mkdir()
    os.chown(folder, USER, USER)
    return folder


@contextmanager
def running(image: Image, network: Network, data: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The image's own command, from the moment that its health check is satisfied; stopped as a container is."""
    log = data.parent / "log"
    with log.open("wb") as file:
        command = image.started(network, image.entrypoint + image.command, data)
        process = subprocess.Popen(command, stdout=file, stderr=file)
    end = time.monotonic() + PATIENCE_SECONDS
    while run(*image.started(network, image.health, data)).returncode != 0:
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, "the health check is not satisfied: " + log.read_text()
        time.sleep(0.2)
    try:
        yield process
    finally:
        (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        os.kill(int(child), signal.SIGTERM)
        assert process.wait(PATIENCE_SECONDS) == 0, log.read_text()


def test_server_image(server: Image, data: Path) -> None:
    """Serves as user 10001 with nothing to write but its volume, and says so to its health check."""
    with Network("fogbank-image") as network, running(server, network, data):
        assert {"audit.log", "lock"} <= {path.name for path in data.iterdir()}
        assert all(path.stat().st_uid == USER for path in data.iterdir())
        refused = run(*server.started(network, ["touch", "/usr/local/bin/other"], data))
        assert "Read-only file system" in refused.stderr
        metrics = run(*server.started(network, ["curl", "--silent", "http://127.0.0.1:9464/metrics"], data))
        assert "fogbank_jobs" in metrics.stdout


def test_server_image_has_no_compiler(server: Image) -> None:
    for name in ("gcc", "cc", "python3", "cmake", "git"):
        assert not list(server.folder.glob(f"usr/bin/{name}")), name


def test_tools_image(server: Image, tools: Image, data: Path) -> None:
    """Makes a token, and renders with it."""
    with Network("fogbank-image") as network:
        created = run(*tools.started(network, ["fogbank", "--data", "/data", "token", "create", "--tenant", "a"], data))
        assert created.returncode == 0, created.stderr
        token = created.stdout.strip()
        shutil.copytree(REPOSITORY / "scenes" / "shafts", data / "scene")
        with running(server, network, data):
            tools.environment["FOGBANK_TOKEN"] = token
            render = [
                "fogbank",
                "--server",
                "127.0.0.1:7071",
                "render",
                "/data/scene/shafts.xml",
                "-o",
                "/data/out.exr",
            ]
            rendered = run(*tools.started(network, [*render, "--spp", "1", "--size", "32x32"], data))
            assert rendered.returncode == 0, rendered.stderr
            assert (data / "out.exr").stat().st_uid == USER
        assert run(*tools.started(network, ["dask", "worker", "--version"], data)).returncode == 0
