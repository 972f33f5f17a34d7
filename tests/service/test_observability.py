"""What a server tells of itself: log lines for programs, traces, slow tiles."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fogbank
import grpc
import pytest
from fogbank._generated.v1 import cache_pb2, render_pb2
from fogbank.paths import server_binary

from tests.service.harness import Server, fog_scene

FAILPOINTS = Path(server_binary()).with_name("fogbankd_failpoints")
TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"
PARENT = "00f067aa0ba902b7"


def spans(path: Path) -> list[dict[str, Any]]:
    """The spans of an OTLP/JSON file."""
    found: list[dict[str, Any]] = []
    for line in path.read_text().splitlines():
        for resource in json.loads(line)["resourceSpans"]:
            assert {"key": "service.name", "value": {"stringValue": "fogbankd"}} in resource["resource"]["attributes"]
            for scope in resource["scopeSpans"]:
                found += scope["spans"]
    return found


def attributes(span: dict[str, Any]) -> dict[str, str | float]:
    """Its attributes by name."""
    return {item["key"]: next(iter(item["value"].values())) for item in span["attributes"]}


def test_a_trace_goes_from_the_client_to_the_last_byte(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--trace", str(tmp_path / "trace.json"))
    scene = tmp_path / "scene.xml"
    scene.write_bytes(fog_scene())
    begin = time.time_ns()
    with fogbank.connect(server.target) as service, fogbank.trace(f"00-{TRACE}-{PARENT}-01"):
        job = service.load(scene).render(integrator="radiance-cache", spp=2, size=(32, 24))
        for _ in job.events():
            pass
    assert server.stop() == 0
    all_spans = spans(tmp_path / "trace.json")
    assert {span["traceId"] for span in all_spans} == {TRACE}
    (root,) = [span for span in all_spans if span["name"] == "job"]
    assert root["parentSpanId"] == PARENT
    parts = [span for span in all_spans if span is not root]
    assert {span["parentSpanId"] for span in parts} == {root["spanId"]}
    assert len({span["spanId"] for span in all_spans}) == len(all_spans)
    assert {"queue", "fill", "tiles", "encode", "send"} <= {span["name"] for span in parts}
    assert {attributes(span)["fogbank.job"] for span in all_spans} == {job.name}
    assert attributes(root)["fogbank.state"] == "JOB_STATE_SUCCEEDED"
    for span in all_spans:
        assert begin - 10**10 < int(span["startTimeUnixNano"]) <= int(span["endTimeUnixNano"]) <= time.time_ns()
    (send,) = [span for span in parts if span["name"] == "send"]
    assert int(attributes(send)["fogbank.bytes"]) > 1000


def test_fills_and_probes_have_spans(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--trace", str(tmp_path / "trace.json"))
    scene = tmp_path / "scene.xml"
    scene.write_bytes(fog_scene(width=16, height=12))
    with fogbank.connect(server.target) as service, fogbank.trace(f"00-{TRACE}-{PARENT}-01"):
        loaded = service.load(scene)
        loaded.cache.fill(integrator="radiance-cache", error=2.0)
        loaded.probe([[0.0, 1.0, 0.0], [0.5, 1.0, 0.0]])
    request = cache_pb2.FillCacheRequest(scene="scenes/" + "0" * 64)
    with pytest.raises(grpc.RpcError):
        list(server.caches.FillCache(request))
    assert server.stop() == 0
    all_spans = spans(tmp_path / "trace.json")
    fill, failed = (span for span in all_spans if span["name"] == "fill_cache")
    (probe,) = (span for span in all_spans if span["name"] == "probe")
    for root, parts in ((fill, {"load", "fill", "save"}), (probe, {"load", "points"})):
        assert (root["traceId"], root["parentSpanId"]) == (TRACE, PARENT)
        assert "status" not in root
        assert attributes(root)["fogbank.scene"] == loaded.name
        assert {span["name"] for span in all_spans if span.get("parentSpanId") == root["spanId"]} == parts
    assert int(attributes(fill)["fogbank.records_new"]) > 0
    (points,) = (span for span in all_spans if span["name"] == "points")
    assert int(attributes(points)["fogbank.points"]) == 2
    assert failed["traceId"] != TRACE
    assert failed["status"] == {"code": 2}
    assert int(attributes(failed)["rpc.grpc.status_code"]) == grpc.StatusCode.NOT_FOUND.value[0]


@pytest.mark.parametrize(
    "traceparent", [None, "00-" + "0" * 32 + f"-{PARENT}-01", "nonsense", f"01-{TRACE}-{PARENT}-01"]
)
def test_without_a_context_a_job_is_its_own_trace(tmp_path: Path, traceparent: str | None) -> None:
    server = Server(tmp_path / "data", "--trace", str(tmp_path / "trace.json"))
    scene = server.create_scene(fog_scene()).name
    metadata = () if traceparent is None else (("traceparent", traceparent),)
    request = render_pb2.CreateJobRequest(request_id="one", scene=scene)
    server.finish(server.render.CreateJob(request, metadata=metadata).job.name)
    assert server.stop() == 0
    (root,) = [span for span in spans(tmp_path / "trace.json") if span["name"] == "job"]
    assert "parentSpanId" not in root
    assert root["traceId"] != TRACE


def test_what_a_client_does_not_sample_is_not_written(tmp_path: Path) -> None:
    server = Server(tmp_path / "data", "--trace", str(tmp_path / "trace.json"))
    scene = server.create_scene(fog_scene()).name
    metadata = (("traceparent", f"00-{TRACE}-{PARENT}-00"),)
    request = render_pb2.CreateJobRequest(request_id="one", scene=scene)
    server.finish(server.render.CreateJob(request, metadata=metadata).job.name)
    assert server.stop() == 0
    assert (tmp_path / "trace.json").read_text() == ""


def test_refused_traceparent() -> None:
    with pytest.raises(fogbank.InvalidArgumentError, match="traceparent"), fogbank.trace("00-1-2-3"):
        pass


def test_the_log_is_json_lines(tmp_path: Path) -> None:
    server = Server(tmp_path, "--log-format", "json")
    hostile = 'a"\n{"level": "fake"}\x1b[1m.xml'
    with pytest.raises(grpc.RpcError):
        server.create_scene({hostile: b"<scene"})
    server.create_scene(fog_scene())
    assert server.stop() == 0
    lines = [json.loads(line) for line in server.log_path.read_text().splitlines()]
    assert {tuple(line) for line in lines} == {("time", "level", "thread", "message")}
    assert all(datetime.fromisoformat(line["time"]).tzinfo == UTC for line in lines)
    assert {line["level"] for line in lines} <= {"info", "warning", "error"}
    assert any("loaded scenes/" in line["message"] for line in lines)


def test_a_stuck_tile_is_reported_and_ends_its_job(tmp_path: Path) -> None:
    options = ("--threads", "2", "--task-report", "1", "--task-limit", "3", "--log-format", "json")
    environment = {"FOGBANK_FAILPOINTS": "job.before_task=delay:20000@5"}
    server = Server(tmp_path, *options, binary=FAILPOINTS, environment=environment)
    scene = server.create_scene(fog_scene()).name
    stuck = server.create_job(scene, render_pb2.RenderSettings(samples_per_pixel=1 << 20)).name
    job = server.watch(stuck)
    assert job.state == render_pb2.JOB_STATE_FAILED
    assert job.error.code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0]
    assert "tile " in job.error.message
    # The other thread goes on working for others.
    server.finish(server.create_job(scene).name)
    messages = [line["message"] for line in map(json.loads, filter(is_json, server.log_path.read_text().splitlines()))]
    assert any(message.startswith(f"{stuck}: tile ") and " of pass " in message for message in messages)
    assert any("a render thread is lost" in message for message in messages)
    server.process.terminate()
    assert server.process.wait(60) == 0


def is_json(line: str) -> bool:
    """Failpoints write lines of their own."""
    return line.startswith("{")
