"""Probe: points in, results out; the same bits however it is asked, fair to jobs, gone when nobody listens."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import grpc
import numpy as np
import psutil
import pytest
from fogbank._generated.v1 import probe_pb2 as probe
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene_messages
from fogbank._generated.v1 import server_pb2

from tests.service.harness import PATIENCE_SECONDS, Points, Server, error_info, fog_scene, probe_requests

# Direct light only, without derivatives: as cheap as a point can be.
CHEAP = probe.ProbeSettings(
    method="unaware",
    order=probe.PROBE_ORDER_SINGLE,
    derivatives=probe.PROBE_DERIVATIVES_VALUE,
    samples=16,
    repeats=1,
    max_depth=2,
)
# Chunks of 256 points, 6 KiB each: the server's receive window of 1 MiB and the client's buffer of 64 KiB hold 181, the
# server's hands 4, the one that it reads and those under way a few.
MOST_CHUNKS_AHEAD = 220

# Minutes of work a point.
ENDLESS = probe.ProbeSettings(method="unaware", samples=4096, repeats=1024)


def random_points(count: int, seed: int = 1) -> Points:
    """Points in the fog, in the block and outside of everything."""
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 3))


def merged(results: list[probe.ProbeResults]) -> probe.ProbeResults:
    """All results as one, without what may differ."""
    whole = probe.ProbeResults()
    for result in results:
        whole.MergeFrom(result)
    whole.first_point = 0
    del whole.seconds[:]
    return whole


def test_results_are_what_they_say(server: Server, scene: scene_messages.Scene) -> None:
    points = np.array([[0.0, 1.0, 0.5], [0.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
    responses = list(server.probe.Probe(probe_requests(scene.name, points, probe.ProbeSettings(samples=64, repeats=2))))
    started = responses[0].started
    assert started.media == ["fog"]
    # Every default is filled in; max_depth is the scene's.
    expected = probe.ProbeSettings(
        method="aware",
        order=probe.PROBE_ORDER_BOTH,
        derivatives=probe.PROBE_DERIVATIVES_HESSIAN,
        samples=64,
        repeats=2,
        max_depth=6,
        bisect=True,
        sliding=True,
        corners=True,
    )
    assert started.settings == expected
    (results,) = (response.results for response in responses[1:])
    # In the fog; in the block, which bounds no medium; outside of everything.
    assert results.medium_index == [0, 0, -1]
    assert all(seconds > 0 for seconds in results.seconds)
    assert all(samples > 0 for samples in results.samples)
    for field in (results.mean, results.standard_error):
        lengths = {name.name: len(values) for name, values in field.ListFields()}
        assert lengths == {
            "radiance": 9,
            "gradient": 27,
            "hessian": 54,
            "luminance": 3,
            "luminance_gradient": 9,
            "luminance_hessian": 18,
        }
        assert all(np.isfinite(values).all() for _, values in field.ListFields())
    # Channels and luminance belong together; the weights are those of Rec. 709.
    weights = np.array([0.212671, 0.715160, 0.072169])
    radiance = np.array(results.mean.radiance).reshape(3, 3)
    np.testing.assert_allclose(results.mean.luminance, radiance @ weights, rtol=1e-12)
    hessian = np.array(results.mean.hessian).reshape(3, 3, 6)
    np.testing.assert_allclose(
        np.array(results.mean.luminance_hessian).reshape(3, 6), np.einsum("pce,c->pe", hessian, weights), rtol=1e-9
    )
    assert (radiance[0] > 0).all()


def test_the_same_bits_for_any_chunks_threads_and_neighbours(
    server: Server, scene: scene_messages.Scene, own_server: Server
) -> None:
    points = random_points(60)
    settings = probe.ProbeSettings(samples=16, repeats=2, seed=5)
    reference = merged(server.probe_points(scene.name, points, settings))
    for chunk in (1, 7, 60):
        assert merged(server.probe_points(scene.name, points, settings, chunk=chunk)) == reference
    alone = merged(server.probe_points(scene.name, points[17:18], settings))
    assert alone.mean.hessian == reference.mean.hessian[17 * 18 : 18 * 18]
    assert own_server.stop() == 0
    single = Server(own_server.data, "--threads", "1")
    try:
        assert merged(single.probe_points(scene_on(single), points, settings)) == reference
    finally:
        assert single.stop() == 0
    settings.seed = 6
    assert merged(server.probe_points(scene.name, points, settings)) != reference


def scene_on(server: Server) -> str:
    """The scene of the fixture on another server."""
    return server.create_scene(fog_scene()).name


def test_what_is_not_asked_for_is_not_sent(server: Server, scene: scene_messages.Scene) -> None:
    points = random_points(3)
    for derivatives, present in (
        (probe.PROBE_DERIVATIVES_VALUE, set[str]()),
        (probe.PROBE_DERIVATIVES_GRADIENT, {"gradient", "luminance_gradient"}),
    ):
        settings = probe.ProbeSettings(samples=16, repeats=2, derivatives=derivatives)
        (results,) = server.probe_points(scene.name, points, settings)
        assert {field.name for field, _ in results.mean.ListFields()} == {"radiance", "luminance"} | present


def test_every_method_of_the_capabilities_answers(server: Server, scene: scene_messages.Scene) -> None:
    methods = server.server.GetCapabilities(server_pb2.GetCapabilitiesRequest()).probe_methods
    assert {method.name for method in methods} >= {"aware", "unaware", "finite-difference"}
    for method in methods:
        assert method.description
        settings = probe.ProbeSettings(method=method.name, samples=16, repeats=1)
        assert len(server.probe_points(scene.name, random_points(2), settings)) == 1


def code_and_reason(server: Server, requests: Iterator[probe.ProbeRequest]) -> tuple[grpc.StatusCode, str, str]:
    """What a stream ends with, and the field or limit that is to blame."""
    with pytest.raises(grpc.RpcError) as caught:
        list(server.probe.Probe(requests))
    info = error_info(caught.value)
    assert isinstance(caught.value, grpc.Call)
    return caught.value.code(), info.reason, info.metadata["field"] or info.metadata["limit"]


@pytest.mark.parametrize(
    ("settings", "field"),
    [
        (probe.ProbeSettings(method="magic"), "method"),
        (probe.ProbeSettings(order=17), "order"),  # type: ignore[arg-type]
        (probe.ProbeSettings(derivatives=17), "derivatives"),  # type: ignore[arg-type]
        (probe.ProbeSettings(samples=15), "samples"),
        (probe.ProbeSettings(samples=(1 << 20) + 1), "samples"),
        (probe.ProbeSettings(repeats=0), "repeats"),
        (probe.ProbeSettings(repeats=1025), "repeats"),
        (probe.ProbeSettings(max_depth=-2), "max_depth"),
    ],
)
def test_settings_out_of_range_are_refused_by_field(
    server: Server, scene: scene_messages.Scene, settings: probe.ProbeSettings, field: str
) -> None:
    # Before any point is sent.
    requests = probe_requests(scene.name, np.zeros((0, 3)), settings)
    assert code_and_reason(server, requests) == (
        grpc.StatusCode.INVALID_ARGUMENT,
        "INVALID_SETTINGS",
        f"settings.{field}",
    )


def test_bad_streams(server: Server, scene: scene_messages.Scene) -> None:
    invalid = grpc.StatusCode.INVALID_ARGUMENT
    header = next(probe_requests(scene.name, np.zeros((0, 3)), CHEAP))

    def points(*coordinates: float) -> probe.ProbeRequest:
        return probe.ProbeRequest(points=probe.ProbePoints(coordinates=coordinates))

    good = points(0.0, 1.0, 0.0)
    for requests, expected in (
        ([], (invalid, "INVALID_PROBE", "")),
        ([good], (invalid, "INVALID_PROBE", "")),
        ([probe.ProbeRequest()], (invalid, "INVALID_PROBE", "")),
        ([header, header], (invalid, "INVALID_PROBE", "")),
        ([header, points()], (invalid, "INVALID_PROBE", "")),
        ([header, probe.ProbeRequest()], (invalid, "INVALID_PROBE", "")),
        ([header, good, points(0, 1, 2, 0, 1)], (invalid, "INVALID_POINT", "points[2]")),
        ([header, good, good, points(0, 1, 2, 0, np.nan, 2)], (invalid, "INVALID_POINT", "points[3]")),
        ([header, points(0, np.inf, 2)], (invalid, "INVALID_POINT", "points[0]")),
        ([header, points(0, 1e39, 2)], (invalid, "INVALID_POINT", "points[0]")),
        ([header, points(*[0.0] * 771)], (invalid, "CHUNK_TOO_LARGE", "max_probe_chunk_points")),
        (probe_requests("scenes/" + "0" * 64, np.zeros((1, 3))), (grpc.StatusCode.NOT_FOUND, "SCENE_NOT_FOUND", "")),
        (probe_requests("jobs/1", np.zeros((1, 3))), (invalid, "INVALID_NAME", "")),
    ):
        assert code_and_reason(server, iter(requests)) == expected
    # The message says what is wrong where.
    with pytest.raises(grpc.RpcError) as caught:
        list(server.probe.Probe(iter([header, points(0, 1, np.inf)])))
    assert isinstance(caught.value, grpc.Call)
    assert caught.value.details() == "points[0]: a coordinate is not finite"


def test_no_points_no_results(server: Server, scene: scene_messages.Scene) -> None:
    assert server.probe_points(scene.name, np.zeros((0, 3))) == []


def test_a_hundred_thousand_points_in_bounded_memory(server: Server, scene: scene_messages.Scene) -> None:
    process = psutil.Process(server.process.pid)
    chunk = random_points(256)
    sent = 0
    most_ahead = 0
    answered = 0
    before = 0

    def requests() -> Iterator[probe.ProbeRequest]:
        nonlocal sent, most_ahead
        yield next(probe_requests(scene.name, np.zeros((0, 3)), CHEAP))
        message = probe.ProbeRequest(points=probe.ProbePoints(coordinates=chunk.ravel()))
        for _ in range(400):
            sent += 1
            most_ahead = max(most_ahead, sent - answered)
            yield message

    first: probe.ProbeResults | None = None
    for response in itertools.islice(server.probe.Probe(requests()), 1, None):
        answered += 1
        if first is None:
            first = response.results
            before = process.memory_info().rss
        else:
            assert response.results.mean == first.mean
    assert answered == 400
    # 102,400 results are 22 MB as they are here; the streams' windows and the allocator's slack are a few.
    assert process.memory_info().rss - before < 12 << 20
    assert most_ahead < MOST_CHUNKS_AHEAD


@pytest.fixture
def busy_machine() -> Iterator[None]:
    """Processes that take the cores from everybody's threads at any moment."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    yield
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("busy_machine")
def test_no_chunk_is_lost(server: Server, scene: scene_messages.Scene) -> None:
    # A message that came between two looks of the stream was once overwritten by the next read, in one of 4,000
    # messages on a busy machine: a result too few, or points that nobody sent.
    points = random_points(500)
    for _ in range(30):
        results = server.probe_points(scene.name, points, CHEAP, chunk=1)
        assert [result.first_point for result in results] == list(range(len(points)))


def test_a_client_that_reads_nothing_stops_the_work(server: Server, scene: scene_messages.Scene) -> None:
    settings = probe.ProbeSettings(samples=16, repeats=1, max_depth=2)
    sent = 0

    def requests() -> Iterator[probe.ProbeRequest]:
        nonlocal sent
        for request in probe_requests(scene.name, random_points(256 * 1000), settings):
            sent += 1
            yield request

    stream = server.probe.Probe(requests())
    next(stream)
    seen = -1
    while sent != seen:
        seen = sent
        time.sleep(1.0)
    assert sent < MOST_CHUNKS_AHEAD
    assert server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).busy_threads == 0
    stream.cancel()


def wait_until_idle(server: Server) -> None:
    """Waits until no stream is open and no thread is busy."""
    end = time.monotonic() + PATIENCE_SECONDS
    while True:
        status = server.server.GetServerStatus(server_pb2.GetServerStatusRequest())
        if status.probes == 0 and status.busy_threads == 0:
            return
        assert time.monotonic() < end, status
        time.sleep(0.01)


def test_cancelling_frees_the_threads(server: Server, scene: scene_messages.Scene) -> None:
    wait_until_idle(server)
    stream = server.probe.Probe(probe_requests(scene.name, random_points(100), ENDLESS))
    next(stream)
    while server.server.GetServerStatus(server_pb2.GetServerStatusRequest()).busy_threads < 2:
        time.sleep(0.01)
    status = server.server.GetServerStatus(server_pb2.GetServerStatusRequest())
    assert status.probes == 1
    stream.cancel()
    wait_until_idle(server)


def test_jobs_go_on_beside_probes(server: Server, scene: scene_messages.Scene) -> None:
    # A stream that idled a while is owed nothing: with work again it shares with the job, and both end.
    stop = threading.Event()

    def requests() -> Iterator[probe.ProbeRequest]:
        messages = probe_requests(scene.name, random_points(1000), probe.ProbeSettings(samples=256))
        yield from itertools.islice(messages, 1)
        time.sleep(0.5)
        yield from messages
        stop.wait()

    stream = server.probe.Probe(requests())
    next(stream)
    job = server.create_job(scene.name, render.RenderSettings(samples_per_pixel=16))
    server.finish(job.name)
    stream.cancel()
    stop.set()
    wait_until_idle(server)


def test_more_streams_than_allowed_are_refused(server: Server, scene: scene_messages.Scene) -> None:
    wait_until_idle(server)
    stop = threading.Event()

    def requests() -> Iterator[probe.ProbeRequest]:
        yield next(probe_requests(scene.name, np.zeros((0, 3)), CHEAP))
        stop.wait()

    streams = [server.probe.Probe(requests()) for _ in range(int(server.limit("max_probes")))]
    for stream in streams:
        next(stream)
    refused = code_and_reason(server, probe_requests(scene.name, np.zeros((1, 3)), CHEAP))
    assert refused == (grpc.StatusCode.RESOURCE_EXHAUSTED, "TOO_MANY_PROBES", "max_probes")
    for stream in streams:
        stream.cancel()
    stop.set()
    wait_until_idle(server)


def test_shutdown_tells_the_streams(own_server: Server) -> None:
    name = scene_on(own_server)
    stop = threading.Event()

    def idle() -> Iterator[probe.ProbeRequest]:
        yield next(probe_requests(name, np.zeros((0, 3)), CHEAP))
        stop.wait()

    streams = [own_server.probe.Probe(idle()), own_server.probe.Probe(probe_requests(name, random_points(9), ENDLESS))]
    for stream in streams:
        next(stream)
    own_server.process.terminate()
    for stream in streams:
        with pytest.raises(grpc.RpcError) as caught:
            list(stream)
        assert error_info(caught.value).reason == "SHUTTING_DOWN"
    stop.set()
    assert own_server.process.wait(PATIENCE_SECONDS) == 0


def test_a_scene_that_is_not_in_memory_is_loaded_again(own_server: Server) -> None:
    name = scene_on(own_server)
    before = merged(own_server.probe_points(name, random_points(4), CHEAP))
    assert own_server.stop() == 0
    again = Server(own_server.data, "--threads", "2")
    try:
        assert merged(again.probe_points(name, random_points(4), CHEAP)) == before
    finally:
        assert again.stop() == 0


def test_the_plan_says_what_is_left_out_and_why(server: Server, scene: scene_messages.Scene) -> None:
    terms = server.probe.GetPlan(probe.GetPlanRequest(scene=scene.name)).terms
    assert all(term.term and term.reason for term in terms)
    assert {term.on for term in terms} == {False, True}
    assert any(term.term.startswith("ratio records of") for term in terms)
    single = server.probe.GetPlan(probe.GetPlanRequest(scene=scene.name, order=probe.PROBE_ORDER_SINGLE)).terms
    assert [term.term for term in single] == [term.term for term in terms]
    assert sum(term.on for term in single) < sum(term.on for term in terms)
    for request, code, reason in (
        (probe.GetPlanRequest(scene="jobs/1"), grpc.StatusCode.INVALID_ARGUMENT, "INVALID_NAME"),
        (probe.GetPlanRequest(scene="scenes/" + "0" * 64), grpc.StatusCode.NOT_FOUND, "SCENE_NOT_FOUND"),
        (
            probe.GetPlanRequest(scene=scene.name, max_depth=-2),
            grpc.StatusCode.INVALID_ARGUMENT,
            "INVALID_SETTINGS",
        ),
    ):
        with pytest.raises(grpc.RpcError) as caught:
            server.probe.GetPlan(request)
        assert isinstance(caught.value, grpc.Call)
        assert (caught.value.code(), error_info(caught.value).reason) == (code, reason)
