"""Clients in great numbers that stall, cancel, die or take all descriptors: faults S1, S3, S4, S5."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from pathlib import Path

import grpc
import psutil
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import server_pb2
from fogbank._generated.v1.render_pb2_grpc import RenderServiceStub
from fogbank.channel import CHANNEL_OPTIONS

from tests.faults.conftest import FULL, Record
from tests.service.harness import Server, fog_scene

STALLED = 1000 if FULL else 50
CANCELS = 10_000 if FULL else 300
KILLED_PROCESSES, STREAMS_OF_EACH = (20, 25) if FULL else (2, 5)
ENDLESS = render.RenderSettings(width=256, height=192, samples_per_pixel=1 << 20, update_interval_seconds=0.05)
MIB = 1 << 20


def resident(server: Server) -> int:
    """Memory of the server's process."""
    return int(psutil.Process(server.process.pid).memory_info().rss)


def status(server: Server) -> server_pb2.GetServerStatusResponse:
    """The server's own figures."""
    return server.server.GetServerStatus(server_pb2.GetServerStatusRequest(), timeout=30)


def rays_per_cpu_second(server: Server, seconds: float) -> float:
    """Of the whole process, over this time: what clients cost shows, and what else the machine does doesn't."""
    process = psutil.Process(server.process.pid)

    def cpu() -> float:
        times = process.cpu_times()
        return float(times.user + times.system)

    rays, before = status(server).rays, cpu()
    time.sleep(seconds)
    return (status(server).rays - rays) / (cpu() - before)


def busy_job(server: Server) -> str:
    """An endless one, of which a pass is done, watched once already."""
    name = server.create_job(server.create_scene(fog_scene()).name, ENDLESS).name
    while server.job(name).progress.passes_done < 2:
        time.sleep(0.05)
    return name


def wait_until_nobody_watches(server: Server) -> float:
    """Seconds until the server knows that all watchers have gone."""
    start = time.monotonic()
    while status(server).watchers > 0:
        time.sleep(0.02)
    return time.monotonic() - start


def test_stalled_watchers(tmp_path: Path, record: Record) -> None:
    server = Server(tmp_path / "data", "--threads", "1")
    name = busy_job(server)
    alone = rays_per_cpu_second(server, 5)
    before = resident(server)
    channels = [grpc.insecure_channel(server.target, options=[*CHANNEL_OPTIONS, ("own", i)]) for i in range(10)]
    streams = [
        RenderServiceStub(channels[i % len(channels)]).WatchJob(render.WatchJobRequest(name=name))
        for i in range(STALLED)
    ]
    for stream in streams:
        next(stream)
    time.sleep(3)
    growth = resident(server) - before
    together = rays_per_cpu_second(server, 5)
    assert status(server).watchers == STALLED
    for channel in channels:
        channel.close()
    gone = wait_until_nobody_watches(server)
    record(f"{STALLED} stalled watchers, MiB", growth / MIB, 256)
    record("rays lost for each CPU second, %", 100 * (1 - together / alone), 5)
    record("seconds until they are forgotten", gone, 5)
    assert growth < 256 * MIB
    server.render.CancelJob(render.CancelJobRequest(name=name))
    assert server.stop() == 0


def test_cancels(tmp_path: Path, record: Record) -> None:
    server = Server(tmp_path / "data", "--threads", "1")
    name = busy_job(server)
    request = render.WatchJobRequest(name=name, without_tiles=True)

    def open_and_cancel(count: int) -> list[float]:
        slowest = []
        for number in range(count):
            server.render.WatchJob(request).cancel()
            if number % 50 == 0:
                start = time.monotonic()
                server.job(name)
                slowest.append(time.monotonic() - start)
        return slowest

    open_and_cancel(CANCELS // 10)
    wait_until_nobody_watches(server)
    before = resident(server)
    times = sorted(open_and_cancel(CANCELS))
    wait_until_nobody_watches(server)
    growth = resident(server) - before
    record(f"{CANCELS} cancels, MiB", growth / MIB, 32)
    record("99 % of other calls within seconds", times[int(0.99 * (len(times) - 1))], 0.25)
    assert growth < 32 * MIB
    server.render.CancelJob(render.CancelJobRequest(name=name))
    assert server.stop() == 0


KILLED_CLIENT = """
import sys
import grpc
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1.render_pb2_grpc import RenderServiceStub
target, name, count = sys.argv[1:]
streams = []
for number in range(int(count)):
    channel = grpc.insecure_channel(target, options=[("own", number), ("grpc.use_local_subchannel_pool", 1)])
    streams.append(RenderServiceStub(channel).WatchJob(render.WatchJobRequest(name=name)))
for stream in streams:
    next(stream)
print("ready", flush=True)
for event in streams[0]:
    pass
"""


def test_killed_clients(tmp_path: Path, record: Record) -> None:
    server = Server(tmp_path / "data", "--threads", "1")
    name = busy_job(server)
    files = psutil.Process(server.process.pid).num_fds()
    slowest = 0.0
    killed = 0
    for _ in range(KILLED_PROCESSES):
        arguments = [sys.executable, "-c", KILLED_CLIENT, server.target, name, str(STREAMS_OF_EACH)]
        client = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
        assert client.stdout is not None
        assert client.stdout.readline() == "ready\n"
        assert status(server).watchers == STREAMS_OF_EACH
        client.kill()
        client.wait()
        slowest = max(slowest, wait_until_nobody_watches(server))
        killed += STREAMS_OF_EACH
    record("clients killed", -killed, -KILLED_PROCESSES * STREAMS_OF_EACH)
    record("seconds until they are forgotten", slowest, 1)
    time.sleep(0.5)
    assert psutil.Process(server.process.pid).num_fds() <= files + 4
    server.render.CancelJob(render.CancelJobRequest(name=name))
    assert server.stop() == 0


@pytest.mark.parametrize("listen", ["127.0.0.1:0", "unix"])
def test_no_descriptors(tmp_path: Path, record: Record, listen: str) -> None:
    address = f"unix:{tmp_path}/socket" if listen == "unix" else listen
    server = Server(tmp_path / "data", "--threads", "1", listen=address, descriptors=80)
    name = server.create_job(server.create_scene(fog_scene()).name, ENDLESS).name
    server.render.PauseJob(render.PauseJobRequest(name=name))
    server.channel.close()
    family = socket.AF_UNIX if listen == "unix" else socket.AF_INET
    host, _, port = server.target.rpartition(":")
    idle = []
    for _ in range(200):
        one = socket.socket(family)
        one.settimeout(1)
        try:
            one.connect(f"{tmp_path}/socket" if listen == "unix" else (host, int(port)))
        except OSError:
            one.close()  # nobody takes connections any more, as it should be
            break
        idle.append(one)
    time.sleep(1)
    for one in idle:
        one.close()
    # It serves again, or it ends by itself to be started again: it is not dead and alive.
    start = time.monotonic()
    while server.process.poll() is None:
        server.connect()
        try:
            status(server)
            break
        except grpc.RpcError:
            server.channel.close()
            time.sleep(1)
    record(f"seconds until it serves or ends, {listen}", time.monotonic() - start, 60)
    if server.process.poll() is None:
        assert server.stop() == 0
    else:
        assert server.process.returncode == 3
        assert "takes no connections any more" in server.log_path.read_text()
    again = Server(server.data, "--threads", "1")
    again.render.CancelJob(render.CancelJobRequest(name=name))
    assert again.watch(name).state == render.JOB_STATE_CANCELLED
    assert again.stop() == 0
