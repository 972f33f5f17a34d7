"""The process: start, stop, what it says about itself, generic tools."""

from __future__ import annotations

import socket
import subprocess
import threading
import urllib.request
from pathlib import Path

import grpc
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene_messages
from fogbank._generated.v1 import server_pb2
from fogbank.channel import CHANNEL_OPTIONS
from fogbank.paths import server_binary
from google.protobuf import descriptor_pool, json_format, message_factory
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase

from tests.service.harness import Server, error_info, fog_scene


def start_fails(*arguments: str | Path) -> str:
    """Starts a server that must refuse; its error message."""
    result = subprocess.run([server_binary(), *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode != 0
    assert result.stdout == "" or "--help" in result.stderr
    return result.stderr


def test_capabilities(server: Server) -> None:
    capabilities = server.server.GetCapabilities(server_pb2.GetCapabilitiesRequest())
    assert capabilities.version
    assert len(capabilities.build_id) == 16
    assert "volpath" in [integrator.name for integrator in capabilities.integrators]
    assert all(integrator.description for integrator in capabilities.integrators)
    names = [limit.name for limit in capabilities.limits]
    assert len(names) == len(set(names))
    assert all(limit.unit and limit.description for limit in capabilities.limits)
    assert {plugins.kind for plugins in capabilities.scene_plugins} >= {"bsdf", "emitter"}
    assert [(argument.name, argument.value) for argument in capabilities.channel_arguments] == list(CHANNEL_OPTIONS)
    assert not capabilities.scene_root


def test_limits_that_the_contract_names_are_told(server: Server) -> None:
    told = {limit.name for limit in server.server.GetCapabilities(server_pb2.GetCapabilitiesRequest()).limits}
    root = Path(__file__).resolve().parents[2] / "proto" / "fogbank" / "v1"
    text = "".join(path.read_text() for path in root.glob("*.proto"))
    for word in text.replace(",", " ").replace(".", " ").replace("`", " ").replace(";", " ").replace(")", " ").split():
        if word.startswith(("max_", "min_probe", "default_")) and word not in ("max_depth", "max_threads", "max_tasks"):
            assert word in told, word


def test_status(server: Server, scene: scene_messages.Scene) -> None:
    job = server.create_job(scene.name)
    server.finish(job.name)
    status = server.server.GetServerStatus(server_pb2.GetServerStatusRequest())
    assert status.uptime_seconds > 0
    assert status.worker_threads == 2
    assert status.jobs.succeeded >= 1
    assert status.scenes >= status.resident_scenes >= 1
    assert status.memory_bytes > 1 << 20
    assert status.rays > 0


def test_generic_tools_find_and_call_everything(server: Server) -> None:
    database = ProtoReflectionDescriptorDatabase(server.channel)
    services = set(database.get_services())
    assert services >= {
        "fogbank.v1.SceneService",
        "fogbank.v1.RenderService",
        "fogbank.v1.ProbeService",
        "fogbank.v1.ServerService",
        "grpc.reflection.v1alpha.ServerReflection",
    }
    # Health by its descriptor alone, as a tool that has never seen the protocol would call it.
    pool = descriptor_pool.DescriptorPool(database)
    method = pool.FindMethodByName("grpc.health.v1.Health.Check")
    request_class = message_factory.GetMessageClass(method.input_type)
    response_class = message_factory.GetMessageClass(method.output_type)
    call = server.channel.unary_unary(
        "/grpc.health.v1.Health/Check",
        request_serializer=request_class.SerializeToString,
        response_deserializer=response_class.FromString,
    )

    def status_of(service: str) -> object:
        return json_format.MessageToDict(call(request_class(service=service)))["status"]

    assert status_of("") == "SERVING"
    for service in sorted(service for service in services if service.startswith("fogbank.v1.")):
        assert pool.FindServiceByName(service).methods
        assert status_of(service) == "SERVING"
    with pytest.raises(grpc.RpcError) as caught:
        status_of("no.such.Service")
    assert caught.value.code() == grpc.StatusCode.NOT_FOUND


def test_sigterm_ends_streams_and_not_jobs(own_server: Server) -> None:
    name = own_server.create_scene(fog_scene()).name
    jobs = [own_server.create_job(name, render.RenderSettings(samples_per_pixel=1 << 20)).name for _ in range(3)]
    ends: list[str] = []
    started = threading.Barrier(len(jobs) * 10 + 1)

    def watch(job: str) -> None:
        stream = own_server.render.WatchJob(render.WatchJobRequest(name=job))
        next(stream)
        started.wait()
        try:
            ends.extend("ended" for event in stream if event.HasField("ended"))
        except grpc.RpcError as error:
            ends.append(error_info(error).reason)

    threads = [threading.Thread(target=watch, args=(job,)) for job in jobs for _ in range(10)]
    for thread in threads:
        thread.start()
    started.wait()
    own_server.process.terminate()
    assert own_server.process.wait(60) == 0
    for thread in threads:
        thread.join()
    assert ends == ["SHUTTING_DOWN"] * len(threads)
    again = Server(own_server.data)
    assert {again.job(job).state for job in jobs} <= {render.JOB_STATE_QUEUED, render.JOB_STATE_RUNNING}
    assert again.stop() == 0


def test_sigterm_with_a_watcher_that_reads_nothing(own_server: Server) -> None:
    name = own_server.create_scene(fog_scene(width=512, height=512)).name
    settings = render.RenderSettings(samples_per_pixel=1 << 20, update_interval_seconds=0.05)
    stream = own_server.render.WatchJob(render.WatchJobRequest(name=own_server.create_job(name, settings).name))
    next(stream)
    own_server.process.terminate()
    assert own_server.process.wait(60) == 0


def test_unix_socket_and_standard_input(tmp_path: Path) -> None:
    socket = tmp_path / "s"
    process = subprocess.Popen(
        [
            server_binary(),
            "--listen",
            f"unix:{socket}",
            "--data",
            tmp_path / "data",
            "--port-file",
            tmp_path / "port",
            "--exit-with-stdin",
        ],
        stdin=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with grpc.insecure_channel(f"unix:{socket}") as channel:
        health = health_pb2_grpc.HealthStub(channel)
        check = health.Check  # type: ignore[attr-defined]  # the stub package lacks the methods
        answer = check(health_pb2.HealthCheckRequest(), wait_for_ready=True, timeout=60)
        assert answer.status == health_pb2.HealthCheckResponse.SERVING
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(60) == 0


def test_refused_options(tmp_path: Path, server: Server) -> None:
    data = tmp_path / "data"
    for address in ("0.0.0.0:0", "[::]:0", "192.0.2.1:0", "example.org:0"):
        assert "--insecure-any-address" in start_fails("--data", data, "--listen", address)
    for address in ("nonsense", "127.0.0.1", "127.0.0.1:70000", "127.0.0.1:x", "::1:0", "unix:", "unix:" + "x" * 108):
        assert "--listen" in start_fails("--data", data, "--listen", address)
    assert "in use" in start_fails("--data", data, "--listen", server.target)
    assert "in use by another fogbankd" in start_fails("--data", server.data, "--listen", "127.0.0.1:0")
    file = tmp_path / "file"
    file.write_text("")
    assert "can't be used" in start_fails("--data", file, "--listen", "127.0.0.1:0")
    assert "scene root" in start_fails("--data", data, "--listen", "127.0.0.1:0", "--scene-root", tmp_path / "none")
    assert "--data" in start_fails()
    assert "--threads" in start_fails("--data", data, "--threads", "-1")


def test_insecure_any_address_is_allowed_when_said(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--insecure-any-address", listen="0.0.0.0:0")
    assert server.target.startswith("0.0.0.0:")
    assert server.stop() == 0


def metrics(address: str) -> dict[str, float]:
    """What Prometheus would read, by name and labels."""
    with urllib.request.urlopen(f"http://{address}/metrics", timeout=60) as answer:
        text = answer.read().decode()
    lines = (line.rpartition(" ") for line in text.splitlines() if not line.startswith("#"))
    return {name: float(value) for name, _, value in lines}


def test_metrics_count_what_happens(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{taken.getsockname()[1]}"
    server = Server(tmp_path / "data", "--metrics", address)
    job = server.create_job(server.create_scene(fog_scene()).name)
    ended = server.finish(job.name)
    result = ended.result
    found = metrics(address)
    assert found['fogbank_jobs{tenant="",state="succeeded"}'] == 1
    assert found['fogbank_jobs{tenant="",state="running"}'] == 0
    assert found['fogbank_rays_total{tenant=""}'] == result.rays
    assert found['fogbank_tiles_total{tenant=""}'] == ended.progress.tiles_total * ended.progress.passes_done
    assert found['fogbank_scenes{tenant="",state="resident"}'] == 1
    assert found['fogbank_memory_bytes{tenant="",kind="films"}'] == 0
    assert found["process_resident_memory_bytes"] > 1 << 20
    assert found['fogbank_reader_confinement{layer="rlimits"}'] == 1
    other = Server(tmp_path / "other")
    assert "in use" in start_fails("--data", tmp_path / "third", "--listen", "127.0.0.1:0", "--metrics", address)
    assert "can be reached by others" in start_fails("--data", tmp_path / "third", "--metrics", "0.0.0.0:9000")
    assert other.stop() == 0
    assert server.stop() == 0
