"""Embedded servers and forks: what starts, what ends, and who notices."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import fogbank
import numpy as np
import psutil
import pytest
from fogbank.embedded import EmbeddedServer
from fogbank.paths import server_binary

from tests.clients.conftest import PATIENT, ROOT
from tests.clients.fake_job import PASSES, radiance
from tests.clients.test_jobs import WHOLE


def is_running(process_id: int) -> bool:
    """True unless the process has ended, reaped or not."""
    try:
        return bool(psutil.Process(process_id).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def wait_for_end(process_id: int) -> None:
    """Waits until a process has ended; the test's own timeout is the limit."""
    while is_running(process_id):
        time.sleep(0.01)


@pytest.mark.usefixtures("fake_binary")
def test_an_embedded_server_lives_as_long_as_the_service(scene_path: Path) -> None:
    with fogbank.connect() as service:
        assert service.embedded
        server = service._server
        assert server is not None
        socket = Path(server.target.removeprefix("unix:"))
        assert stat.S_IMODE(socket.parent.stat().st_mode) == 0o700
        job = service.load(scene_path).render()
        np.testing.assert_array_equal(np.asarray(job.result()), radiance(WHOLE, PASSES - 1))
    assert not is_running(server.process_id)
    assert not socket.parent.exists()


def data_folder_of(server: EmbeddedServer) -> Path:
    """What the server was told to use."""
    command = psutil.Process(server.process_id).cmdline()
    return Path(command[command.index("--data") + 1])


@pytest.mark.usefixtures("fake_binary")
def test_embedded_servers_side_by_side_do_not_share_a_data_directory() -> None:
    servers = [EmbeddedServer(), EmbeddedServer()]
    folders = [data_folder_of(server) for server in servers]
    for server in servers:
        server.stop()
    assert len(set(folders)) == 2
    again = EmbeddedServer()
    folder = data_folder_of(again)
    again.stop()
    assert folder == folders[0]


@pytest.mark.usefixtures("fake_binary")
def test_the_data_directory_can_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FOGBANK_DATA", str(tmp_path / "by variable"))
    for server, folder in (
        (EmbeddedServer(data=tmp_path / "by argument"), "by argument"),
        (EmbeddedServer(), "by variable"),
    ):
        used = data_folder_of(server)
        server.stop()
        assert used == tmp_path / folder
        assert used.is_dir()


@pytest.mark.usefixtures("fake_binary")
def test_a_server_that_does_not_come_up_shows_its_log() -> None:
    expected = r"did not come up \(exit status 1\); its log ends with:(.|\n)*in use by process 4711"
    with pytest.raises(fogbank.ServerStartError, match=expected):
        fogbank.connect(scene_root="fail")


@pytest.mark.usefixtures("fake_binary")
def test_a_server_that_dies_is_reported_at_once(scene_path: Path) -> None:
    with fogbank.connect(retry_policy=PATIENT) as service:
        scene = service.load(scene_path)
        assert service._server is not None
        os.kill(service._server.process_id, signal.SIGKILL)
        with pytest.raises(fogbank.ServerStartError, match=r"the embedded server died \(signal 9\)"):
            for _ in range(100):
                scene.render()


@pytest.mark.usefixtures("fake_binary")
def test_a_temporary_folder_too_long_for_a_socket_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    long = tmp_path / ("x" * 100)
    long.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(long))
    with pytest.raises(fogbank.ServerStartError, match=r"too long a path.*TMPDIR"):
        fogbank.connect()
    assert list(long.iterdir()) == []


def test_a_missing_binary_says_where_it_was_looked_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FOGBANK_SERVER_BINARY", str(tmp_path / "none"))
    with pytest.raises(fogbank.ServerStartError, match=r"FOGBANK_SERVER_BINARY names .*none"):
        fogbank.connect()
    monkeypatch.delenv("FOGBANK_SERVER_BINARY")
    monkeypatch.setattr("fogbank.paths.__file__", str(tmp_path / "a" / "b" / "c" / "d" / "paths.py"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(fogbank.ServerStartError, match=r"build/release/bin/fogbankd does not exist.*PATH"):
        server_binary()
    (tmp_path / "fogbankd").write_text("#!/bin/sh\n")
    (tmp_path / "fogbankd").chmod(0o755)
    assert server_binary() == tmp_path / "fogbankd"


def run_program(text: str) -> subprocess.Popen[str]:
    """Runs a Python program that can import the package and the tests."""
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(text)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        stdout=subprocess.PIPE,
        text=True,
    )


@pytest.mark.usefixtures("fake_binary")
@pytest.mark.parametrize("end", ["exit", "kill"])
def test_the_server_ends_with_the_program_however_that_ends(end: str) -> None:
    with run_program(
        f"""
        import time, fogbank
        service = fogbank.connect()
        print(service._server.process_id, flush=True)
        time.sleep({1000 if end == "kill" else 0})
        """
    ) as program:
        assert program.stdout is not None
        process_id = int(program.stdout.readline())
        if end == "kill":
            assert is_running(process_id)
            program.kill()
    wait_for_end(process_id)


def test_forked_children_get_channels_of_their_own(address: str, scene_path: Path) -> None:
    # The server lives in this process; a program of its own does the forking, as users' programs do.
    program = f"""
        import multiprocessing, threading
        import fogbank
        service = fogbank.connect({address!r})
        scene = service.load({str(scene_path)!r})
        # Streams are open, one of them with a reader waiting in another thread, while children are forked.
        stream = scene.render(integrator="endless").tiles()
        next(stream)
        endless = scene.render(integrator="endless")
        def read():
            try:
                for tile in endless.tiles(): pass
            except fogbank.FogbankError: pass
        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        context = multiprocessing.get_context("fork")
        def render(results):
            results.put(float(scene.render().result().sum()))
        results = context.Queue()
        children = [context.Process(target=render, args=(results,)) for _ in range(4)]
        for child in children: child.start()
        for child in children: child.join()
        print(*[results.get() for _ in children], float(scene.render().result().sum()), flush=True)
        next(stream)
        # A thread that decodes a tile while the interpreter ends would be torn out of C++ code and abort the process.
        service.close()
        reader.join()
        """
    with run_program(program) as process:
        output, _ = process.communicate()
    assert process.returncode == 0
    expected = float(radiance(WHOLE, PASSES - 1).sum())
    assert [float(number) for number in output.split()] == [expected] * 5
