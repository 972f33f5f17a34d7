"""A server by the wire contract, in memory and in Python, that fails exactly when a test tells it to.

It is for tests of the client alone; what a real server does is tested end to end.
"""

from __future__ import annotations

import hashlib
import math
import posixpath
import re
import threading
import time
from collections.abc import Iterable, Iterator
from concurrent import futures
from dataclasses import dataclass, field

import grpc
from fogbank._generated.v1 import (
    cache_pb2_grpc,
    probe_pb2,
    probe_pb2_grpc,
    render_pb2,
    render_pb2_grpc,
    scene_pb2,
    scene_pb2_grpc,
    server_pb2,
    server_pb2_grpc,
)

from tests.clients import fake_probe
from tests.clients.fake_cache_service import FakeCacheService
from tests.clients.fake_caches import CACHE, FakeCaches
from tests.clients.fake_job import CACHED, ENDLESS, FAILING, NORMAL, FakeJob, fail

CHUNK_LIMIT = 64
LOAD_SECONDS = 0.25
_PAGE_SIZE = 2

_REFERENCE = re.compile(r'filename="([^"]+)"')
_SEARCH_FOLDER = re.compile(r'<path value="([^"]+)"')


@dataclass
class Faults:
    """What is to go wrong; each list is used up, one entry per call."""

    unavailable_calls: int = 0
    """So many unary calls answer UNAVAILABLE first."""

    cut_uploads_after: list[int] = field(default_factory=list)
    """Chunks after which an upload stream breaks."""

    cut_watches_after: list[int] = field(default_factory=list)
    """Events after which a WatchJob stream breaks."""

    cut_downloads_after: list[int] = field(default_factory=list)
    """Chunks after which a DownloadImage stream breaks."""

    uploads_in_progress: int = 0
    """So many uploads find another one under way."""

    cancel_watches: int = 0
    """So many WatchJob streams are cut as those of readers that stall, after the snapshot."""

    end_watches_early: int = 0
    """So many WatchJob streams end with OK after the snapshot, without a terminal event."""

    cut_probes_after: list[int] = field(default_factory=list)
    """Messages after which a Probe stream breaks."""

    damage_image: bool = False
    """DownloadImage sends other bytes than announced."""


class FakeServer(
    scene_pb2_grpc.SceneServiceServicer,
    render_pb2_grpc.RenderServiceServicer,
    probe_pb2_grpc.ProbeServiceServicer,
    server_pb2_grpc.ServerServiceServicer,
):
    """The services; `start` makes them reachable.

    Attributes:
        faults: what is to go wrong.
        blobs: complete uploads by SHA-256.
        partial: incomplete uploads by SHA-256.
        scenes, jobs: by name.
        chunks_received: number of upload messages with bytes.
        upload_offsets: where each upload stream began.
        create_job_requests: as they came.
        probe_headers: as they came.
        caches: the one cache.
    """

    def __init__(self) -> None:
        """Holds nothing."""
        self.faults = Faults()
        self.blobs: dict[str, bytes] = {}
        self.partial: dict[str, bytearray] = {}
        self.scenes: dict[str, scene_pb2.Scene] = {}
        self.jobs: dict[str, FakeJob] = {}
        self.chunks_received = 0
        self.upload_offsets: list[int] = []
        self.create_job_requests: list[render_pb2.CreateJobRequest] = []
        self.probe_headers: list[probe_pb2.ProbeHeader] = []
        self.caches = FakeCaches()
        self.hold_jobs = False
        self._lock = threading.Lock()
        self._server: grpc.Server | None = None

    def start(self, address: str) -> int:
        """Listens on "127.0.0.1:0" or "unix:/path"; returns the port."""
        self._server = grpc.server(futures.ThreadPoolExecutor(max_workers=32))
        scene_pb2_grpc.add_SceneServiceServicer_to_server(self, self._server)
        render_pb2_grpc.add_RenderServiceServicer_to_server(self, self._server)
        probe_pb2_grpc.add_ProbeServiceServicer_to_server(self, self._server)
        cache_pb2_grpc.add_CacheServiceServicer_to_server(FakeCacheService(self.caches, self.blobs), self._server)
        server_pb2_grpc.add_ServerServiceServicer_to_server(self, self._server)
        port = self._server.add_insecure_port(address)
        self._server.start()
        return port

    def stop(self) -> None:
        """Ends everything."""
        for job in self.jobs.values():
            job.go_on.set()
            job.cancel()
        if self._server is not None:
            self._server.stop(0).wait()

    # Scenes

    def PrepareScene(  # noqa: N802 - as in the contract
        self, request: scene_pb2.PrepareSceneRequest, context: grpc.ServicerContext
    ) -> scene_pb2.PrepareSceneResponse:
        """Finds file names in the XML by a regular expression."""
        self._maybe_unavailable(context)
        manifest = request.manifest
        listed = {entry.path for entry in manifest.entries}
        missing = sorted({entry.sha256 for entry in manifest.entries} - set(self.blobs))
        unlisted: list[str] = []
        for entry in manifest.entries:
            if entry.path.endswith(".xml") and entry.sha256 in self.blobs:
                candidates = self._references(entry, context)
                if not any(path in listed for group in candidates for path in group):
                    unlisted += [path for group in candidates for path in group]
                else:
                    unlisted += [path for group in candidates if not listed & set(group) for path in group]
        return scene_pb2.PrepareSceneResponse(missing_blobs=missing, unlisted_paths=sorted(set(unlisted)))

    def _references(self, entry: scene_pb2.ManifestEntry, context: grpc.ServicerContext) -> list[list[str]]:
        text = self.blobs[entry.sha256].decode()
        folders = ["", *_SEARCH_FOLDER.findall(text)]
        groups = []
        for reference in _REFERENCE.findall(text):
            group = [
                posixpath.normpath(posixpath.join(posixpath.dirname(entry.path), folder, reference))
                for folder in folders
            ]
            if group[0].startswith(".."):
                fail(context, 3, "PATH_OUTSIDE_ROOT", f"{entry.path}:2: <shape>: {reference} is outside the root")
            groups.append(group)
        return groups

    def QueryBlob(  # noqa: N802
        self, request: scene_pb2.QueryBlobRequest, context: grpc.ServicerContext
    ) -> scene_pb2.QueryBlobResponse:
        """As in the contract."""
        if request.sha256 in self.blobs:
            return scene_pb2.QueryBlobResponse(committed_size=len(self.blobs[request.sha256]), complete=True)
        return scene_pb2.QueryBlobResponse(committed_size=len(self.partial.get(request.sha256, b"")))

    def UploadBlob(  # noqa: N802
        self, request_iterator: Iterable[scene_pb2.UploadBlobRequest], context: grpc.ServicerContext
    ) -> scene_pb2.UploadBlobResponse:
        """As in the contract; breaks off as the faults say."""
        messages = iter(request_iterator)
        header = next(messages).header
        if self.faults.uploads_in_progress > 0:
            self.faults.uploads_in_progress -= 1
            fail(context, 10, "UPLOAD_IN_PROGRESS", "another stream is writing this blob")
        data = self.partial.setdefault(header.sha256, bytearray())
        self.upload_offsets.append(header.offset)
        if header.offset == 0:
            data.clear()
        if header.offset != len(data):
            fail(context, 11, "UPLOAD_OFFSET_MISMATCH", "wrong offset", committed_size=str(len(data)))
        left = self.faults.cut_uploads_after.pop(0) if self.faults.cut_uploads_after else None
        for message in messages:
            if left == 0:
                context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
            if len(message.chunk) > CHUNK_LIMIT:
                fail(context, 3, "CHUNK_TOO_LARGE", "chunk too large")
            data += message.chunk
            self.chunks_received += 1
            left = None if left is None else left - 1
        if len(data) != header.size:
            self.partial.pop(header.sha256)
            fail(context, 3, "BLOB_SIZE_MISMATCH", "more or fewer bytes than declared")
        if hashlib.sha256(data).hexdigest() != header.sha256:
            self.partial.pop(header.sha256)
            fail(context, 3, "BLOB_HASH_MISMATCH", "the bytes have another SHA-256")
        self.blobs[header.sha256] = bytes(self.partial.pop(header.sha256))
        return scene_pb2.UploadBlobResponse(committed_size=header.size)

    def CreateScene(  # noqa: N802
        self, request: scene_pb2.CreateSceneRequest, context: grpc.ServicerContext
    ) -> scene_pb2.CreateSceneResponse:
        """Accepts any XML without "<broken" whose files are all there."""
        self._maybe_unavailable(context)
        manifest = request.manifest
        main = next(entry for entry in manifest.entries if entry.path == manifest.main_path)
        text = self.blobs[main.sha256].decode()
        if "<broken" in text:
            fail(context, 3, "SCENE_INVALID", f"{main.path}:2: <broken>: unknown element; supported are ...")
        if "<grid" in text:
            fail(context, 12, "NOT_SUPPORTED", f"{main.path}:2: <grid>: not supported yet")
        listed = {entry.path for entry in manifest.entries}
        for group in self._references(main, context):
            if not listed & set(group):
                fail(context, 5, "FILE_NOT_FOUND", f"{main.path}:2: <shape>: no such file: {group[0]}")
        fingerprint = hashlib.sha256(manifest.SerializeToString(deterministic=True)).hexdigest()
        name = f"scenes/{fingerprint}"
        known = name in self.scenes
        if not known:
            self.scenes[name] = _scene(name, main.path, lenient=manifest.options.lenient)
        return scene_pb2.CreateSceneResponse(scene=self.scenes[name], already_loaded=known)

    def GetScene(  # noqa: N802
        self, request: scene_pb2.GetSceneRequest, context: grpc.ServicerContext
    ) -> scene_pb2.GetSceneResponse:
        """As in the contract."""
        if request.name not in self.scenes:
            fail(context, 5, "SCENE_NOT_FOUND", f"there is no {request.name}")
        return scene_pb2.GetSceneResponse(scene=self.scenes[request.name])

    def ListScenes(  # noqa: N802
        self, request: scene_pb2.ListScenesRequest, context: grpc.ServicerContext
    ) -> scene_pb2.ListScenesResponse:
        """Two a page."""
        first = int(request.page_token or 0)
        scenes = list(reversed(self.scenes.values()))
        token = str(first + _PAGE_SIZE) if first + _PAGE_SIZE < len(scenes) else ""
        return scene_pb2.ListScenesResponse(scenes=scenes[first : first + _PAGE_SIZE], next_page_token=token)

    def DeleteScene(  # noqa: N802
        self, request: scene_pb2.DeleteSceneRequest, context: grpc.ServicerContext
    ) -> scene_pb2.DeleteSceneResponse:
        """As in the contract."""
        if self.scenes.pop(request.name, None) is None:
            fail(context, 5, "SCENE_NOT_FOUND", f"there is no {request.name}")
        return scene_pb2.DeleteSceneResponse()

    # Jobs

    def CreateJob(  # noqa: N802
        self, request: render_pb2.CreateJobRequest, context: grpc.ServicerContext
    ) -> render_pb2.CreateJobResponse:
        """Starts a job; idempotent by request id."""
        self._maybe_unavailable(context)
        self.create_job_requests.append(request)
        if request.scene not in self.scenes:
            fail(context, 5, "SCENE_NOT_FOUND", f"there is no {request.scene}")
        if request.settings.integrator not in ("", NORMAL, CACHED, ENDLESS, FAILING):
            message = f"integrator: {request.settings.integrator!r} is unknown; known are volpath"
            fail(context, 3, "INVALID_SETTINGS", message, field="settings.integrator")
        if request.settings.samples_per_pixel > 1000:
            fail(context, 8, "TOO_MANY_JOBS", "too many unfinished jobs")
        with self._lock:
            for job in self.jobs.values():
                if job.message.request_id == request.request_id:
                    return render_pb2.CreateJobResponse(job=job.message)
            job = FakeJob(f"jobs/{hashlib.sha256(request.request_id.encode()).hexdigest()[:16]}", request)
            self.jobs[job.message.name] = job
        if self.hold_jobs:
            job.go_on.clear()
        job.start()
        return render_pb2.CreateJobResponse(job=job.message)

    def GetJob(  # noqa: N802
        self, request: render_pb2.GetJobRequest, context: grpc.ServicerContext
    ) -> render_pb2.GetJobResponse:
        """As in the contract."""
        self._maybe_unavailable(context)
        return render_pb2.GetJobResponse(job=self._job(request.name, context).message)

    def ListJobs(  # noqa: N802
        self, request: render_pb2.ListJobsRequest, context: grpc.ServicerContext
    ) -> render_pb2.ListJobsResponse:
        """Two a page."""
        first = int(request.page_token or 0)
        jobs = [
            job.message
            for job in reversed(self.jobs.values())
            if not request.states or job.message.state in request.states
        ]
        token = str(first + _PAGE_SIZE) if first + _PAGE_SIZE < len(jobs) else ""
        return render_pb2.ListJobsResponse(jobs=jobs[first : first + _PAGE_SIZE], next_page_token=token)

    def CancelJob(  # noqa: N802
        self, request: render_pb2.CancelJobRequest, context: grpc.ServicerContext
    ) -> render_pb2.CancelJobResponse:
        """As in the contract."""
        job = self._job(request.name, context)
        job.cancel()
        job.go_on.set()
        return render_pb2.CancelJobResponse(job=job.message)

    def PauseJob(  # noqa: N802
        self, request: render_pb2.PauseJobRequest, context: grpc.ServicerContext
    ) -> render_pb2.PauseJobResponse:
        """As in the contract, for jobs that never end: the others are too quick to be held."""
        job = self._job(request.name, context)
        if job.message.state == render_pb2.JOB_STATE_RUNNING:
            job.message.state = render_pb2.JOB_STATE_PAUSED
        return render_pb2.PauseJobResponse(job=job.message)

    def ResumeJob(  # noqa: N802
        self, request: render_pb2.ResumeJobRequest, context: grpc.ServicerContext
    ) -> render_pb2.ResumeJobResponse:
        """As in the contract."""
        job = self._job(request.name, context)
        if job.message.state == render_pb2.JOB_STATE_PAUSED:
            job.message.state = render_pb2.JOB_STATE_RUNNING
        return render_pb2.ResumeJobResponse(job=job.message)

    def WatchJob(  # noqa: N802
        self, request: render_pb2.WatchJobRequest, context: grpc.ServicerContext
    ) -> Iterator[render_pb2.WatchJobResponse]:
        """As in the contract; breaks off as the faults say."""
        job = self._job(request.name, context)
        left = self.faults.cut_watches_after.pop(0) if self.faults.cut_watches_after else None
        events = job.events(request)
        try:
            for event in events:
                if left == 0:
                    context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
                if not context.is_active():
                    return
                yield event
                left = None if left is None else left - 1
                if self.faults.cancel_watches > 0:
                    self.faults.cancel_watches -= 1
                    context.abort(grpc.StatusCode.CANCELLED, "")
                if self.faults.end_watches_early > 0:
                    self.faults.end_watches_early -= 1
                    return
        finally:
            events.close()  # type: ignore[attr-defined]

    def DownloadImage(  # noqa: N802
        self, request: render_pb2.DownloadImageRequest, context: grpc.ServicerContext
    ) -> Iterator[render_pb2.DownloadImageResponse]:
        """As in the contract, in small chunks; breaks off as the faults say."""
        job = self._job(request.name, context)
        if not job.image:
            fail(context, 9, "NO_IMAGE", "the job failed or was cancelled")
        data = bytes(reversed(job.image)) if self.faults.damage_image else job.image
        sha256 = hashlib.sha256(job.image).hexdigest()
        left = self.faults.cut_downloads_after.pop(0) if self.faults.cut_downloads_after else None
        for offset in range(request.offset, len(data), 1000):
            if left == 0:
                context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
            chunk = data[offset : offset + 1000]
            yield render_pb2.DownloadImageResponse(size=len(data), sha256=sha256, offset=offset, chunk=chunk)
            left = None if left is None else left - 1

    # Probes

    def Probe(  # noqa: N802
        self, request_iterator: Iterable[probe_pb2.ProbeRequest], context: grpc.ServicerContext
    ) -> Iterator[probe_pb2.ProbeResponse]:
        """As in the contract; breaks off as the faults say; refuses points whose x is not finite."""
        requests = iter(request_iterator)
        header = next(requests).header
        self.probe_headers.append(header)
        if header.settings.method not in ("", fake_probe.METHOD):
            message = f"settings.method: {header.settings.method!r} is not one of: aware"
            fail(context, 3, "INVALID_SETTINGS", message, field="settings.method")
        left = self.faults.cut_probes_after.pop(0) if self.faults.cut_probes_after else None

        def checked() -> Iterator[probe_pb2.ProbeRequest]:
            received = 0
            for request in requests:
                for x in request.points.coordinates[::3]:
                    if not math.isfinite(x):
                        name = f"points[{received}]"
                        fail(context, 3, "INVALID_POINT", f"{name}: a coordinate is not finite", field=name)
                    received += 1
                yield request

        for response in fake_probe.answers(header, checked()):
            if left == 0:
                context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
            yield response
            left = None if left is None else left - 1

    def GetPlan(  # noqa: N802
        self, request: probe_pb2.GetPlanRequest, context: grpc.ServicerContext
    ) -> probe_pb2.GetPlanResponse:
        """Two terms, one of them as the request has it."""
        self._maybe_unavailable(context)
        reason = f"{probe_pb2.ProbeOrder.Name(request.order)}, max_depth {request.max_depth}"
        return probe_pb2.GetPlanResponse(
            terms=[
                probe_pb2.PlanTerm(term="light grids", on=True, reason=reason),
                probe_pb2.PlanTerm(term="sphere grid", on=False, reason="no surface reflects light"),
            ]
        )

    # Server

    def GetCapabilities(  # noqa: N802
        self, request: server_pb2.GetCapabilitiesRequest, context: grpc.ServicerContext
    ) -> server_pb2.GetCapabilitiesResponse:
        """A small chunk limit, so that small files take several chunks."""
        self._maybe_unavailable(context)
        return server_pb2.GetCapabilitiesResponse(
            version="0.0.1",
            build_id="fake",
            integrators=[
                server_pb2.Integrator(name=NORMAL, description="path tracing in fog"),
                server_pb2.Integrator(name=CACHED, description="reads records", cached=True),
            ],
            probe_methods=[server_pb2.ProbeMethod(name=fake_probe.METHOD, description="sees what blocks light")],
            limits=[
                server_pb2.Limit(name="max_upload_chunk_bytes", value=CHUNK_LIMIT, unit="bytes", description="chunk")
            ],
            scene_plugins=[server_pb2.ScenePlugins(kind="shape", names=["obj", "ply"])],
        )

    def GetServerStatus(  # noqa: N802
        self, request: server_pb2.GetServerStatusRequest, context: grpc.ServicerContext
    ) -> server_pb2.GetServerStatusResponse:
        """Counts."""
        return server_pb2.GetServerStatusResponse(
            uptime_seconds=65.0, scenes=len(self.scenes), worker_threads=2, memory_bytes=50_000_000
        )

    def _job(self, name: str, context: grpc.ServicerContext) -> FakeJob:
        if name not in self.jobs:
            fail(context, 5, "JOB_NOT_FOUND", f"there is no {name}")
        return self.jobs[name]

    def _maybe_unavailable(self, context: grpc.ServicerContext) -> None:
        if self.faults.unavailable_calls > 0:
            self.faults.unavailable_calls -= 1
            context.abort(grpc.StatusCode.UNAVAILABLE, "try again")


def _scene(name: str, main_path: str, *, lenient: bool) -> scene_pb2.Scene:
    scene = scene_pb2.Scene(
        name=name,
        main_path=main_path,
        radiance_fingerprint="0" * 64,
        resident=True,
        statistics=scene_pb2.SceneStatistics(triangles=12, shapes=1, lights=1, media=1),
        load_times=scene_pb2.LoadTimes(total_seconds=LOAD_SECONDS),
        warnings=[f"{main_path}:3: <bsdf>: replaced by diffuse"] if lenient else [],
        defaults=scene_pb2.RenderDefaults(
            width=40,
            height=24,
            integrator=NORMAL,
            samples_per_pixel=4,
            max_depth=-1,
            # At (0, 0, -5), looking along +z.
            camera_to_world=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -5, 0, 0, 0, 1],
        ),
        bounds=scene_pb2.BoundingSphere(x=0, y=0, z=0, radius=2),
        cache=CACHE,
    )
    scene.create_time.FromSeconds(int(time.time()))
    return scene
