"""Scene files are taken apart in processes of their own."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import grpc
import pytest
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene
from fogbank._generated.v1 import server_pb2

from tests.service.harness import Server, error_info, fog_scene, new_request_id


def children(process: int) -> dict[int, str]:
    """Processes of a process, with what they call themselves."""
    found = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            fields = dict(line.split(":\t", 1) for line in status.read_text().splitlines() if ":\t" in line)
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields["PPid"]) == process:
            found[int(fields["Pid"])] = fields["Name"]
    return found


def test_a_host_that_is_killed_is_replaced(own_server: Server) -> None:
    own_server.create_scene(fog_scene())
    for _ in range(2):
        ((host, _name),) = children(own_server.process.pid).items()
        os.kill(host, signal.SIGKILL)
        name = own_server.create_scene(fog_scene(extra="<!-- another -->")).name
        own_server.scenes.DeleteScene(scene.DeleteSceneRequest(name=name))
        assert list(children(own_server.process.pid).values()) == ["reader-host"]
    job = own_server.create_job(own_server.create_scene(fog_scene()).name, render.RenderSettings(width=8))
    own_server.finish(job.name)


def test_readers_and_hosts_end(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--threads", "1")
    server.create_scene(fog_scene())
    ((host, name),) = children(server.process.pid).items()
    assert name == "reader-host"
    assert children(host) == {}
    server.kill()
    status = Path(f"/proc/{host}/status")
    while status.exists() and "State:\tZ" not in status.read_text():
        pass  # the test's limit is against hanging


def test_the_server_says_how_readers_are_confined(server: Server) -> None:
    server.create_scene(fog_scene())
    layers = server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).reader_confinement
    assert [layer.name for layer in layers] == ["rlimits", "seccomp", "landlock"]
    assert layers[0].in_force
    for layer in layers:
        assert layer.in_force == (layer.problem == "")


def test_a_reader_sees_no_other_file(server: Server) -> None:
    files = {
        "scene.xml": fog_scene(
            extra='<shape type="ply"><string name="filename" value="../../../../etc/passwd"/></shape>'
        )
    }
    for data in files.values():
        server.upload(data)
    request = scene.CreateSceneRequest(request_id=new_request_id(), manifest=server.manifest(files))
    with pytest.raises(grpc.RpcError) as refused:
        server.scenes.CreateScene(request)
    assert error_info(refused.value).reason == "PATH_OUTSIDE_ROOT"


def test_what_kept_the_server_down_is_refused(server: Server) -> None:
    """Objects that refer to each other without end once overflowed the stack of whatever walked them."""
    chain = "".join(f'<bsdf type="twosided" id="b{i}"><ref id="b{i - 1}"/></bsdf>' for i in range(1, 100_000))
    data = f'<scene version="3.0.0"><bsdf type="diffuse" id="b0"/>{chain}</scene>'.encode()
    server.upload(data)
    request = scene.CreateSceneRequest(request_id=new_request_id(), manifest=server.manifest({"scene.xml": data}))
    with pytest.raises(grpc.RpcError) as refused:
        server.scenes.CreateScene(request)
    assert error_info(refused.value).reason == "XML_TOO_DEEP"
