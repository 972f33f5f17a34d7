"""Who may call, and what they can learn of each other: tokens, scopes, tenants, TLS, certificates."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import grpc
import pytest
from fogbank._generated.v1 import cache_pb2, flatland_pb2, probe_pb2, render_pb2, scene_pb2, server_pb2
from fogbank._generated.v1.server_pb2_grpc import ServerServiceStub
from fogbank.certificates import CertificateFiles, issue_client, issue_server, make_authority
from fogbank.credentials import Credentials
from fogbank.paths import server_binary
from fogbank.tokens import SCOPES, TokenFile
from google.protobuf import message_factory
from google.protobuf.descriptor import MethodDescriptor
from grpc_health.v1 import health_pb2, health_pb2_grpc

from tests.service.harness import Server, error_info, fog_scene, sha256

HOUR = 3600.0

SERVICES = [
    service
    for module in (cache_pb2, flatland_pb2, probe_pb2, render_pb2, scene_pb2, server_pb2)
    for service in module.DESCRIPTOR.services_by_name.values()
]
METHODS: list[MethodDescriptor] = [method for service in SERVICES for method in service.methods]

# The contract, written down a second time: which scopes are good for which rpc. An rpc that is missing here fails.
ANY, READ, RENDER, UPLOAD, ADMIN = {"render", "upload"}, {"render", "upload"}, {"render"}, {"upload"}, set[str]()
GOOD_FOR = {
    "ServerService": {"GetCapabilities": ANY, "GetServerStatus": ANY},
    "SceneService": {
        "PrepareScene": UPLOAD,
        "QueryBlob": UPLOAD,
        "UploadBlob": UPLOAD,
        "CreateScene": UPLOAD,
        "GetScene": READ,
        "ListScenes": READ,
        "DeleteScene": UPLOAD,
    },
    "RenderService": dict.fromkeys(
        ("CreateJob", "GetJob", "ListJobs", "CancelJob", "PauseJob", "ResumeJob", "WatchJob", "DownloadImage"), RENDER
    ),
    "ProbeService": dict.fromkeys(("Probe", "GetPlan"), RENDER),
    "FlatlandService": dict.fromkeys(("ProbeFlatland", "FillFlatlandCache"), RENDER),
    "CacheService": {
        **dict.fromkeys(("GetCache", "ListCaches", "VerifyCache", "ExportCache"), READ),
        **dict.fromkeys(("ViewCache", "FillCache"), RENDER),
        **dict.fromkeys(("ImportCache", "MergeCaches", "DeleteCache"), UPLOAD),
        "CollectCacheGarbage": ADMIN,
    },
}


def call(channel: grpc.Channel, method: MethodDescriptor, token: str | None) -> grpc.StatusCode:
    """Calls an rpc with an empty request; how it ended. Also checks that a refusal says why."""
    service = method.containing_service.full_name
    path = f"/{service}/{method.name}"
    request = message_factory.GetMessageClass(method.input_type)()
    serialize = type(request).SerializeToString
    parse = message_factory.GetMessageClass(method.output_type).FromString
    metadata = () if token is None else (("authorization", token),)
    one = iter([request])
    try:
        if method.client_streaming and method.server_streaming:
            list(channel.stream_stream(path, serialize, parse)(one, metadata=metadata, timeout=60))
        elif method.client_streaming:
            channel.stream_unary(path, serialize, parse)(one, metadata=metadata, timeout=60)
        elif method.server_streaming:
            list(channel.unary_stream(path, serialize, parse)(request, metadata=metadata, timeout=60))
        else:
            channel.unary_unary(path, serialize, parse)(request, metadata=metadata, timeout=60)
    except grpc.RpcError as error:
        assert isinstance(error, grpc.Call)
        assert error_info(error).reason
        return error.code()
    return grpc.StatusCode.OK


@dataclass
class Guarded:
    """A server on loopback that asks for tokens."""

    server: Server
    tokens: TokenFile

    def token(self, tenant: str, *scopes: str, lifetime: float | None = None) -> str:
        """As a caller sends it."""
        return "Bearer " + self.tokens.create(tenant, scopes or SCOPES, lifetime)[1]

    def connected(self, tenant: str, *scopes: str) -> Server:
        """The same server as this tenant's client sees it."""
        text = self.token(tenant, *scopes).removeprefix("Bearer ")
        time.sleep(1.1)  # the server looks at the file once a second
        _, calls = Credentials(token=text).channel(self.server.target, ())
        return self.server.seen_through(calls)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    """One for all tests."""
    data = tmp_path_factory.mktemp("guarded")
    server = Server(data, "--require-tokens", "--threads", "2")
    yield Guarded(server, TokenFile(data))
    assert server.process.poll() is None, "the server died"
    assert server.stop() == 0


def test_the_matrix_names_every_rpc() -> None:
    named = {(service, method) for service, methods in GOOD_FOR.items() for method in methods}
    assert named == {(method.containing_service.name, method.name) for method in METHODS}


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_rpc_asks_who_calls(guarded: Guarded, method: MethodDescriptor) -> None:
    channel = guarded.server.channel
    good = guarded.tokens.create("matrix", SCOPES, HOUR)[1]
    revoked, revoked_text = guarded.tokens.create("matrix", SCOPES, HOUR)
    guarded.tokens.revoke(revoked.id)
    expired_text = guarded.tokens.create("matrix", SCOPES, 0)[1]
    scoped = {scope: guarded.tokens.create("matrix", [scope], None)[1] for scope in SCOPES}
    time.sleep(1.1)
    for text in (
        None,
        "",
        "Bearer",
        "Bearer ",
        f"Basic {good}",
        good,
        f"Bearer {good}x",
        f"Bearer {good[:-1]}",
        f"Bearer fogbank_{revoked.id}_{good.rpartition('_')[2]}",
        f"Bearer {revoked_text}",
        f"Bearer {expired_text}",
        "Bearer fogbank__",
        "Bearer " + "x" * 4000,
    ):
        assert call(channel, method, text) == grpc.StatusCode.UNAUTHENTICATED, text
    good_for = GOOD_FOR[method.containing_service.name][method.name] | {"admin"}
    for scope, text in scoped.items():
        refused = call(channel, method, f"Bearer {text}") == grpc.StatusCode.PERMISSION_DENIED
        assert refused == (scope not in good_for), scope


def test_reasons_tell_what_to_do(guarded: Guarded) -> None:
    def reason(token: str | None) -> str:
        metadata = () if token is None else (("authorization", token),)
        with pytest.raises(grpc.RpcError) as caught:
            guarded.server.server.GetServerStatus(server_pb2.GetServerStatusRequest(), metadata=metadata)
        return str(error_info(caught.value).reason)

    revoked, text = guarded.tokens.create("reasons", SCOPES, None)
    guarded.tokens.revoke(revoked.id)
    expired = guarded.token("reasons", lifetime=0)
    time.sleep(1.1)
    assert reason(None) == "TOKEN_MISSING"
    assert reason("Bearer nonsense") == "TOKEN_INVALID"
    assert reason(f"Bearer {text}") == "TOKEN_REVOKED"
    assert reason(expired) == "TOKEN_EXPIRED"


def test_health_needs_no_token(guarded: Guarded) -> None:
    health = health_pb2_grpc.HealthStub(guarded.server.channel)
    check = health.Check  # type: ignore[attr-defined]  # the stub package lacks the methods
    assert check(health_pb2.HealthCheckRequest()).status == health_pb2.HealthCheckResponse.SERVING


def test_tenants_are_strangers(guarded: Guarded) -> None:
    alice, bob = guarded.connected("alice"), guarded.connected("bob")
    files = fog_scene()
    scene = alice.create_scene(files)
    job = alice.create_job(scene.name, render_pb2.RenderSettings(integrator="radiance-cache", samples_per_pixel=2))
    result = alice.finish(job.name).result

    def not_found(ask: Callable[[], object]) -> None:
        with pytest.raises(grpc.RpcError) as caught:
            ask()
        assert caught.value.code() == grpc.StatusCode.NOT_FOUND

    # Bob knows every name, and the bytes themselves.
    not_found(lambda: bob.scenes.GetScene(scene_pb2.GetSceneRequest(name=scene.name)))
    not_found(lambda: bob.scenes.DeleteScene(scene_pb2.DeleteSceneRequest(name=scene.name)))
    not_found(lambda: bob.create_job(scene.name))
    not_found(lambda: bob.job(job.name))
    not_found(lambda: bob.render.CancelJob(render_pb2.CancelJobRequest(name=job.name)))
    not_found(lambda: bob.render.PauseJob(render_pb2.PauseJobRequest(name=job.name)))
    not_found(lambda: bob.watch(job.name))
    not_found(lambda: bob.download(job.name))
    not_found(lambda: bob.fill(scene.name))
    not_found(lambda: bob.export(result.cache))
    not_found(lambda: bob.caches.GetCache(cache_pb2.GetCacheRequest(name=result.cache)))
    not_found(lambda: bob.caches.DeleteCache(cache_pb2.DeleteCacheRequest(name=result.cache)))
    presence = bob.scenes.QueryBlob(scene_pb2.QueryBlobRequest(sha256=sha256(files)))
    assert not presence.complete
    assert presence.committed_size == 0
    manifest = bob.manifest({"scene.xml": files})
    missing = bob.scenes.PrepareScene(scene_pb2.PrepareSceneRequest(manifest=manifest)).missing_blobs
    assert len(missing) == 1
    assert not bob.render.ListJobs(render_pb2.ListJobsRequest()).jobs
    assert not bob.scenes.ListScenes(scene_pb2.ListScenesRequest()).scenes
    assert not bob.caches.ListCaches(cache_pb2.ListCachesRequest()).caches
    status = bob.server.GetServerStatus(server_pb2.GetServerStatusRequest())
    assert status.tenant == "bob"
    assert (status.scenes, status.jobs.succeeded, status.rays, status.cache_memory_bytes) == (0, 0, 0, 0)

    # The same scene of his own has the same name, and shares nothing: he makes his records himself.
    own = bob.create_scene(files)
    assert own.name == scene.name
    own_job = bob.create_job(own.name, job.settings)
    assert bob.finish(own_job.name).result.records_reused == 0
    bob.scenes.DeleteScene(scene_pb2.DeleteSceneRequest(name=own.name))
    assert alice.scenes.GetScene(scene_pb2.GetSceneRequest(name=scene.name)).scene.name == scene.name


def test_request_ids_are_each_tenants_own(guarded: Guarded) -> None:
    names = set()
    for tenant, seed in (("carol", 1), ("dave", 2)):
        client = guarded.connected(tenant)
        settings = render_pb2.RenderSettings(seed=seed, samples_per_pixel=1)
        scene = client.create_scene(fog_scene()).name
        request = render_pb2.CreateJobRequest(request_id="the-same", scene=scene, settings=settings)
        names.add(client.render.CreateJob(request).job.name)
    assert len(names) == 2


def test_tenants_and_their_jobs_come_back(tmp_path: Path) -> None:
    server = Server(tmp_path, "--require-tokens")
    guarded = Guarded(server, TokenFile(tmp_path))
    client = guarded.connected("erin")
    endless = render_pb2.RenderSettings(samples_per_pixel=1 << 20)
    name = client.create_job(client.create_scene(fog_scene()).name, endless).name
    server.kill()
    again = Guarded(Server(tmp_path, "--require-tokens"), guarded.tokens)
    assert again.connected("erin").job(name).restarts == 1
    with pytest.raises(grpc.RpcError) as caught:
        again.connected("frank").job(name)
    assert caught.value.code() == grpc.StatusCode.NOT_FOUND
    assert again.server.stop() == 0


def test_the_audit_log_knows_who_did_what_and_no_secret_is_anywhere(tmp_path: Path) -> None:
    server = Server(tmp_path, "--require-tokens", "--log-level", "debug")
    guarded = Guarded(server, TokenFile(tmp_path))
    texts = [guarded.tokens.create("grace", SCOPES, None)[1] for _ in range(2)]
    time.sleep(1.1)
    _, calls = Credentials(token=texts[0]).channel(server.target, ())
    client = server.seen_through(calls)
    job = client.create_job(client.create_scene(fog_scene()).name)
    client.finish(job.name)
    image = client.download(job.name)
    wrong = texts[1][:-4] + "\x1b[1m"
    for forged in (wrong, texts[1] + "\n{}"):
        with pytest.raises((grpc.RpcError, ValueError)):
            server.server.GetServerStatus(
                server_pb2.GetServerStatusRequest(), metadata=(("authorization", f"Bearer {forged}"),)
            )
    lines = [json.loads(line) for line in (tmp_path / "audit.log").read_text().splitlines()]
    created = next(line for line in lines if line["rpc"] == "RenderService.CreateJob")
    assert created["tenant"] == "grace"
    assert created["by"] == texts[0].split("_")[1]
    assert created["outcome"] == "allowed"
    assert created["peer"].startswith("ipv4:127.0.0.1:")
    assert server.stop() == 0
    secrets = [text.rpartition("_")[2].encode() for text in texts]
    for path in tmp_path.rglob("*"):
        if path.is_file():
            data = path.read_bytes()
            assert not any(secret in data for secret in secrets), path
    assert not any(secret in image for secret in secrets)


def refusal(data: Path, *arguments: str | Path) -> str:
    """What a server that does not start says."""
    command: list[str | Path] = [server_binary(), "--data", data, *arguments]
    failed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert failed.returncode == 1
    return failed.stderr


@dataclass
class Pki:
    """An authority, a certificate for this machine, a worker's."""

    folder: Path
    server: CertificateFiles
    worker: CertificateFiles

    @classmethod
    def make(cls, folder: Path) -> Pki:
        """In `folder`."""
        make_authority(folder)
        return cls(folder, issue_server(folder, ["localhost", "127.0.0.1"]), issue_client(folder, "farm"))

    @property
    def options(self) -> tuple[str, ...]:
        """For fogbankd."""
        files = (self.server.certificate, self.server.key, self.folder / "ca.pem")
        names = ("--tls-certificate", "--tls-key", "--tls-client-ca")
        return tuple(text for name, file in zip(names, files, strict=True) for text in (name, str(file)))


def status_through(target: str, credentials: Credentials) -> server_pb2.GetServerStatusResponse:
    """One call over a new connection."""
    channel, calls = credentials.channel(target, ())
    try:
        stub = ServerServiceStub(calls)
        return stub.GetServerStatus(server_pb2.GetServerStatusRequest(), timeout=30)
    finally:
        channel.close()


def test_tls_and_what_it_refuses(tmp_path: Path) -> None:
    pki = Pki.make(tmp_path / "pki")
    stranger = Pki.make(tmp_path / "stranger")
    server = Server(tmp_path / "data", *pki.options, listen="0.0.0.0:0")
    port = server.target.rpartition(":")[2]
    target = f"localhost:{port}"
    token = TokenFile(tmp_path / "data").create("heidi", ["render"], None)[1]
    time.sleep(1.1)
    ca = pki.folder / "ca.pem"

    assert status_through(target, Credentials(token=token, ca=ca)).tenant == "heidi"
    worker = Credentials(ca=ca, certificate=pki.worker.certificate, key=pki.worker.key)
    assert status_through(target, worker).tenant == "farm"

    def refused(credentials: Credentials, where: str = target) -> grpc.StatusCode:
        with pytest.raises(grpc.RpcError) as caught:
            status_through(where, credentials)
        return caught.value.code()

    assert refused(Credentials(ca=ca)) == grpc.StatusCode.UNAUTHENTICATED
    assert refused(Credentials(token=token)) == grpc.StatusCode.UNAVAILABLE  # in the clear
    assert refused(Credentials(token=token, ca=stranger.folder / "ca.pem")) == grpc.StatusCode.UNAVAILABLE
    assert refused(Credentials(token=token, tls=True)) == grpc.StatusCode.UNAVAILABLE  # the machine's authorities
    wrong_name = f"127.0.0.2:{port}"
    assert refused(Credentials(token=token, ca=ca), wrong_name) == grpc.StatusCode.UNAVAILABLE
    forged = Credentials(ca=ca, certificate=stranger.worker.certificate, key=stranger.worker.key)
    assert refused(forged) == grpc.StatusCode.UNAVAILABLE
    # A server's certificate is signed by the same authority and makes nobody a client.
    confused = Credentials(ca=ca, certificate=pki.server.certificate, key=pki.server.key)
    assert refused(confused) == grpc.StatusCode.UNAVAILABLE
    for version, accepted in (("-tls1_1", False), ("-tls1_2", True), ("-tls1_3", True)):
        probe = subprocess.run(
            ["openssl", "s_client", "-connect", f"127.0.0.1:{port}", version, "-CAfile", ca],
            input=b"",
            capture_output=True,
            timeout=60,
            check=False,
        )
        assert (b"BEGIN CERTIFICATE" in probe.stdout) == accepted, version

    # A renewed certificate counts without a restart, and so does one that mends a broken pair.
    before = pki.server.certificate.read_bytes()
    issue_server(pki.folder, ["localhost"])
    assert pki.server.certificate.read_bytes() != before
    good = Credentials(token=token, ca=ca)
    while refused_or_none(f"127.0.0.1:{port}", good) is None:
        time.sleep(0.5)
    assert status_through(target, good).tenant == "heidi"
    pki.server.key.write_text("nonsense")
    time.sleep(2)
    issue_server(pki.folder, ["localhost"])
    while refused_or_none(target, good) is not None:
        time.sleep(0.5)
    assert server.stop() == 0


def refused_or_none(target: str, credentials: Credentials) -> grpc.StatusCode | None:
    """How a call is refused; None if it is not."""
    try:
        status_through(target, credentials)
    except grpc.RpcError as error:
        assert isinstance(error, grpc.Call)
        return error.code()
    return None


def test_what_is_no_certificate_is_refused_at_the_start(tmp_path: Path) -> None:
    pki = Pki.make(tmp_path / "pki")
    other = Pki.make(tmp_path / "other")
    data = tmp_path / "data"
    listen = ("--listen", "0.0.0.0:0")
    assert "--tls-certificate" in refusal(data, *listen)
    assert "belong together" in refusal(data, *listen, "--tls-certificate", pki.server.certificate)
    good = ("--tls-certificate", pki.server.certificate)
    assert "--tls-key" in refusal(data, *listen, *good, "--tls-key", other.server.key)
    assert "--tls-key" in refusal(data, *listen, *good, "--tls-key", tmp_path / "none")
    assert "--tls-certificate" in refusal(
        data, *listen, "--tls-certificate", pki.server.key, "--tls-key", pki.server.key
    )


def test_a_token_file_that_breaks_keeps_the_tokens_of_before(tmp_path: Path) -> None:
    server = Server(tmp_path, "--require-tokens")
    client = Guarded(server, TokenFile(tmp_path)).connected("ivan")
    client.scenes.ListScenes(scene_pb2.ListScenesRequest())
    (tmp_path / "tokens.json").write_text("{")
    time.sleep(1.1)
    client.scenes.ListScenes(scene_pb2.ListScenesRequest())
    assert "what it said before counts" in server.log_path.read_text()
    (tmp_path / "tokens.json").unlink()
    time.sleep(1.1)
    with pytest.raises(grpc.RpcError) as caught:
        client.scenes.ListScenes(scene_pb2.ListScenesRequest())
    assert error_info(caught.value).reason == "TOKEN_INVALID"
    assert server.stop() == 0
