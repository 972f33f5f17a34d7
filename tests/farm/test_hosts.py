"""Schedulers and workers that are processes of their own: restarts, other networks, certificates."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import fogbank
import pytest
from fogbank import RenderOptions, farm

from tests.farm.conftest import Expected, Record
from tests.farm.scenes import PATHS, RECORDS, TILES, assert_same_pictures, write_scene
from tests.service.networks import other_host

pytestmark = pytest.mark.farm

DASK = Path(sys.executable).parent / "dask"

# Two hosts side by side, joined by a cable of so many bits per second.
LINK_RATE = "200mbit"


@contextlib.contextmanager
def running(*command: str | Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is killed in the end."""
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def looked_after(*command: str | Path) -> Iterator[None]:
    """A process that is started again whenever it ends, as systemd or Kubernetes do it."""
    done = threading.Event()

    def look_after() -> None:
        while not done.is_set():
            with running(*command) as process:
                while process.poll() is None and not done.wait(0.1):
                    pass

    thread = threading.Thread(target=look_after)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def wait_for_port(host: str, port: int) -> None:
    """Returns when somebody listens there: on a busy machine a scheduler takes longer to start than clients wait."""
    while True:
        with contextlib.suppress(OSError), socket.create_connection((host, port), timeout=1.0):
            return
        time.sleep(0.1)


def scheduler(port: int, *arguments: str) -> Sequence[str | Path]:
    """The command of a scheduler."""
    return (DASK, "scheduler", "--port", str(port), "--no-dashboard", *arguments)


def worker(address: str, folder: Path, *arguments: str) -> Sequence[str | Path]:
    """The command of a worker."""
    own = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(folder))
    return (DASK, "worker", address, *own, *arguments)


def test_a_scheduler_that_is_started_again(
    service: fogbank.Service, tmp_path: Path, expected: Expected, record: Record
) -> None:
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(running(*scheduler(port, "--host", "127.0.0.1")))
        for number in range(2):
            stack.enter_context(looked_after(*worker(address, tmp_path / str(number))))
        wait_for_port("127.0.0.1", port)
        client = stack.enter_context(farm.scheduler_client(address))
        client.wait_for_workers(2)
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **TILES)
        while job.refresh().progress.fraction < 0.2:
            time.sleep(0.05)
        first.kill()
        first.wait()
        stack.enter_context(running(*scheduler(port, "--host", "127.0.0.1")))
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(TILES).image)
    assert job.farm.lost > 0
    record("batches lost with the scheduler", job.farm.lost, "")


@pytest.mark.parametrize("options", [TILES, RECORDS], ids=["tiles", "records"])
def test_workers_behind_a_slow_link(
    service: fogbank.Service, tmp_path: Path, expected: Expected, record: Record, options: RenderOptions
) -> None:
    with other_host("fogbank-farm", "10.213.7") as cable, contextlib.ExitStack() as stack:
        cable.limit(LINK_RATE)
        port = free_port()
        address = f"tcp://{cable.here}:{port}"
        stack.enter_context(running(*scheduler(port, "--host", cable.here)))
        there = worker(address, tmp_path / "there", "--host", cable.there)
        stack.enter_context(running(*cable.inside(*map(str, there))))
        stack.enter_context(running(*worker(address, tmp_path / "here", "--host", cable.here)))
        wait_for_port(cable.here, port)
        client = stack.enter_context(farm.scheduler_client(address))
        client.wait_for_workers(2)
        began = time.monotonic()
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **options)
        image = job.result()
        record(f"one of two workers behind {LINK_RATE}", time.monotonic() - began, "s")
        job.join_farm()
    assert_same_pictures(image, expected(options).image)
    assert sum(f"//{cable.there}:" in address for address in job.farm.workers) == 1


def test_scheduler_and_workers_with_certificates(service: fogbank.Service, tmp_path: Path, expected: Expected) -> None:
    from distributed import Security

    made = Security.temporary()
    files = {}
    for name, text in (("ca", made.tls_ca_file), ("cert", made.tls_client_cert), ("key", made.tls_client_key)):
        files[name] = tmp_path / f"{name}.pem"
        files[name].write_text(str(text))
    tls = ["--tls-ca-file", str(files["ca"]), "--tls-cert", str(files["cert"]), "--tls-key", str(files["key"])]
    port = free_port()
    address = f"tls://127.0.0.1:{port}"
    with contextlib.ExitStack() as stack:
        stack.enter_context(running(*scheduler(port, "--host", "tls://127.0.0.1", "--protocol", "tls", *tls)))
        stack.enter_context(running(*worker(address, tmp_path / "worker", *tls)))
        wait_for_port("127.0.0.1", port)
        certificates = farm.SchedulerTls(files["ca"], files["cert"], files["key"])
        client = stack.enter_context(farm.scheduler_client(address, certificates))
        client.wait_for_workers(1)
        job = farm.render(service.load(write_scene(tmp_path / "scene")), client, **PATHS)
        image = job.result()
        job.join_farm()
    assert_same_pictures(image, expected(PATHS).image)


def test_addresses_and_certificates_belong_together(tmp_path: Path) -> None:
    files = farm.SchedulerTls(tmp_path / "ca", tmp_path / "cert", tmp_path / "key")
    with pytest.raises(fogbank.InvalidArgumentError, match="tls://"), farm.scheduler_client("tcp://127.0.0.1:1", files):
        pass
    with pytest.raises(fogbank.InvalidArgumentError, match="tls://"), farm.scheduler_client("tls://127.0.0.1:1"):
        pass
