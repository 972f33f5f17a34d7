"""Quotas of tenants: an exhausted one refuses, names itself and says when to ask again; the others go on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import grpc
import numpy as np
import pytest
from fogbank._generated.v1 import cache_pb2, render_pb2, server_pb2
from fogbank.credentials import Credentials
from fogbank.quotas import EVERYBODY_ELSE, Quota, QuotaFile
from fogbank.tokens import SCOPES, TokenFile

from tests.service.harness import Server, error_info, fog_scene, new_request_id, probe_requests, retry_seconds, sha256
from tests.service.test_caches import cached_scene, settings

ENDLESS = render_pb2.RenderSettings(samples_per_pixel=1 << 20)


class Tenants:
    """A server with quotas, and its tenants' clients."""

    def __init__(self, data: Path) -> None:
        """Starts it."""
        self.server = Server(data, "--require-tokens", "--threads", "2")
        self._tokens = TokenFile(data)
        self._quotas = QuotaFile(data)

    def client(self, tenant: str, quota: Quota | None = None) -> Server:
        """What a tenant with this quota sees of it."""
        if quota is not None:
            self._quotas.set(tenant, quota)
        text = self._tokens.create(tenant, SCOPES, None)[1]
        time.sleep(1.1)  # the server looks at the files once a second
        return self.server.seen_through(Credentials(token=text).channel(self.server.target, ())[1])


@pytest.fixture(scope="module")
def tenants(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tenants]:
    """One for all tests."""
    tenants = Tenants(tmp_path_factory.mktemp("quotas"))
    yield tenants
    assert tenants.server.process.poll() is None, "the server died"
    assert tenants.server.stop() == 0


def refused(limit: str, call: Callable[[], object]) -> float:
    """Checks that a quota refuses; the seconds after which to ask again."""
    with pytest.raises(grpc.RpcError) as caught:
        call()
    assert caught.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    info = error_info(caught.value)
    assert info.reason == "QUOTA_EXCEEDED"
    assert info.metadata["limit"] == limit
    assert limit in (caught.value.details() or "")
    seconds = retry_seconds(caught.value)
    assert seconds is not None
    assert seconds > 0
    return seconds


def use_of(client: Server, name: str) -> server_pb2.QuotaUse:
    """A quota as the status shows it."""
    status = client.server.GetServerStatus(server_pb2.GetServerStatusRequest())
    return next(use for use in status.quotas if use.name == name)


def test_jobs(tenants: Tenants) -> None:
    client = tenants.client("jobs", Quota(jobs=2))
    scene = client.create_scene(fog_scene()).name
    requests = [
        render_pb2.CreateJobRequest(request_id=new_request_id(), scene=scene, settings=ENDLESS) for _ in range(2)
    ]
    jobs = [client.render.CreateJob(request).job.name for request in requests]
    refused("jobs", lambda: client.create_job(scene, ENDLESS))
    # A retry of what was acknowledged is no new job.
    assert client.render.CreateJob(requests[0]).job.name == jobs[0]
    use = use_of(client, "jobs")
    assert (use.used, use.limit) == (2, 2)
    assert use.retry_after_seconds > 0
    other = tenants.client("unbounded")
    other.finish(other.create_job(other.create_scene(fog_scene()).name).name)
    for name in jobs:
        client.render.CancelJob(render_pb2.CancelJobRequest(name=name))
        client.watch(name)
    client.finish(client.create_job(scene).name)


def test_stored_bytes(tenants: Tenants) -> None:
    client = tenants.client("bytes", Quota(stored_bytes=3_000_000))
    client.upload(bytes(1_000_000))
    refused("stored_bytes", lambda: client.upload(b"x" * 2_500_000))
    client.upload(b"y" * 1_000_000)
    refused("stored_bytes", lambda: client.upload(b"z" * 1_000_000))
    # What is there needs no more room, and what is small still fits.
    client.upload(bytes(1_000_000))
    scene = client.create_scene(fog_scene()).name
    client.finish(client.create_job(scene, render_pb2.RenderSettings(width=16, samples_per_pixel=1)).name)
    large = render_pb2.RenderSettings(width=1024, height=768, pixel_type=render_pb2.PIXEL_TYPE_FLOAT)
    refused("stored_bytes", lambda: client.create_job(scene, large))
    assert 2_000_000 < use_of(client, "stored_bytes").used < 3_000_000


def test_cache_bytes(tenants: Tenants) -> None:
    cached = settings()
    client = tenants.client("caches", Quota(cache_bytes=1000))
    scene = client.create_scene(cached_scene()).name
    made = client.finish(client.create_job(scene, cached).name).result.cache
    time.sleep(1.1)  # the folders are looked through once a second
    refused("cache_bytes", lambda: client.create_job(scene, cached))
    refused("cache_bytes", lambda: list(client.caches.FillCache(cache_pb2.FillCacheRequest(scene=scene))))
    exported = client.upload(client.export(made))
    request = cache_pb2.ImportCacheRequest(sha256=exported)
    refused("cache_bytes", lambda: client.caches.ImportCache(request))
    client.caches.DeleteCache(cache_pb2.DeleteCacheRequest(name=made))
    time.sleep(1.1)
    client.finish(client.create_job(scene, cached).name)


def test_watchers(tenants: Tenants) -> None:
    client = tenants.client("watchers", Quota(watchers=1))
    scene = client.create_scene(fog_scene()).name
    name = client.create_job(scene, ENDLESS).name
    stream = client.render.WatchJob(render_pb2.WatchJobRequest(name=name))
    next(stream)
    refused("watchers", lambda: next(client.render.WatchJob(render_pb2.WatchJobRequest(name=name))))
    client.render.CancelJob(render_pb2.CancelJobRequest(name=name))
    assert list(stream)[-1].WhichOneof("event") == "ended"
    while use_of(client, "watchers").used:
        time.sleep(0.01)
    client.watch(name)


def test_cpu_seconds(tenants: Tenants) -> None:
    client = tenants.client("cpu", Quota(cpu_seconds=0.5, window_seconds=12))
    scene = client.create_scene(fog_scene()).name
    endless = client.create_job(scene, ENDLESS).name
    while not use_of(client, "cpu_seconds").retry_after_seconds:
        time.sleep(0.1)
    assert refused("cpu_seconds", lambda: client.create_job(scene)) <= 12
    points = np.zeros((1, 3))
    refused("cpu_seconds", lambda: list(client.probe.Probe(probe_requests(scene, points))))
    # What runs is held, once its tasks have ended, and goes on when the window has moved on.
    held = -1
    while client.job(endless).progress.rays != held:
        held = client.job(endless).progress.rays
        time.sleep(1)
    while client.job(endless).progress.rays == held:
        time.sleep(0.2)
    # A held job can be cancelled.
    client.render.CancelJob(render_pb2.CancelJobRequest(name=endless))
    assert client.watch(endless).state == render_pb2.JOB_STATE_CANCELLED


def test_everybody_else_and_changes(tenants: Tenants) -> None:
    first = tenants.client("first")
    scene = first.create_scene(fog_scene()).name
    quotas = QuotaFile(tenants.server.data)
    quotas.set(EVERYBODY_ELSE, Quota(jobs=0))
    time.sleep(1.1)
    refused("jobs", lambda: first.create_job(scene))
    quotas.set("first", Quota(jobs=1))
    time.sleep(1.1)
    first.finish(first.create_job(scene).name)
    quotas.remove(EVERYBODY_ELSE)
    (tenants.server.data / "quotas.json").write_text('{"version": 1, "quotas": {"first": {"jobs": -1}}}')
    time.sleep(1.1)
    first.finish(first.create_job(scene).name)  # by what the file said before
    assert "quotas.json can't be read" in tenants.server.log_path.read_text()
    (tenants.server.data / "quotas.json").unlink()


def test_without_tokens_everybody_else_is_the_one_user(tmp_path: Path) -> None:
    QuotaFile(tmp_path).set(EVERYBODY_ELSE, Quota(stored_bytes=100_000))
    server = Server(tmp_path)
    refused("stored_bytes", lambda: server.upload(bytes(200_000)))
    assert sha256(b"small") == server.upload(b"small")
    assert server.stop() == 0
