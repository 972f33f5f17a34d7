"""A real fogbankd and the raw stubs, as a client in any language would use them."""

from __future__ import annotations

import copy
import hashlib
import io
import os
import signal
import subprocess
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import grpc
import numpy as np
import numpy.typing as npt
import OpenEXR
from fogbank._generated.v1 import cache_pb2 as cache
from fogbank._generated.v1 import probe_pb2 as probe
from fogbank._generated.v1 import render_pb2 as render
from fogbank._generated.v1 import scene_pb2 as scene
from fogbank._generated.v1 import server_pb2 as server
from fogbank._generated.v1.cache_pb2_grpc import CacheServiceStub
from fogbank._generated.v1.farm_pb2_grpc import FarmServiceStub
from fogbank._generated.v1.flatland_pb2_grpc import FlatlandServiceStub
from fogbank._generated.v1.probe_pb2_grpc import ProbeServiceStub
from fogbank._generated.v1.render_pb2_grpc import RenderServiceStub
from fogbank._generated.v1.scene_pb2_grpc import SceneServiceStub
from fogbank._generated.v1.server_pb2_grpc import ServerServiceStub
from fogbank.channel import CHANNEL_OPTIONS
from fogbank.paths import server_binary
from google.rpc import error_details_pb2
from grpc_status import rpc_status

Pixels = npt.NDArray[np.float32]
Points = npt.NDArray[np.float64]

CHUNK_BYTES = 64 << 10

# Against hanging only.
PATIENCE_SECONDS = 120.0


def fog_scene(*, width: int = 64, height: int = 48, samples: int = 4, extra: str = "") -> bytes:
    """A small room of fog with a lamp and a block: everything that the kernel does, in little time."""
    return f"""<scene version="3.0.0">
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="{samples}"/></sampler>
    <film type="hdrfilm">
      <integer name="width" value="{width}"/><integer name="height" value="{height}"/>
      <rfilter type="gaussian"/>
    </film>
    <ref id="fog"/>
  </sensor>
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.2, 0.25, 0.3"/><rgb name="albedo" value="0.8, 0.8, 0.7"/>
    <phase type="hg"><float name="g" value="0.7"/></phase>
  </medium>
  <shape type="cube">
    <transform name="to_world"><scale value="6"/></transform>
    <bsdf type="null"/>
    <ref name="interior" id="fog"/>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><translate y="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 7, 6"/></emitter>
  </shape>
  <shape type="cube">
    <transform name="to_world"><scale value="0.5"/><rotate y="1" angle="30"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf>
  </shape>
  {extra}
</scene>
""".encode()


def new_request_id() -> str:
    """A request id that nobody else uses."""
    return uuid.uuid4().hex


def sha256(data: bytes) -> str:
    """As the wire contract writes it."""
    return hashlib.sha256(data).hexdigest()


def error_info(error: grpc.RpcError) -> error_details_pb2.ErrorInfo:
    """The ErrorInfo that every error of the service carries."""
    assert isinstance(error, grpc.Call)
    status = rpc_status.from_call(error)
    assert status is not None, f"no details: {error}"
    info = error_details_pb2.ErrorInfo()
    assert status.details[0].Unpack(info)
    assert info.domain == "fogbank"
    return info


def retry_seconds(error: grpc.RpcError) -> float | None:
    """The RetryInfo of an error, if it has one."""
    assert isinstance(error, grpc.Call)
    status = rpc_status.from_call(error)
    assert status is not None
    info = error_details_pb2.RetryInfo()
    found = next((detail for detail in status.details if detail.Unpack(info)), None)
    return None if found is None else info.retry_delay.ToTimedelta().total_seconds()


def decode(exr: bytes) -> tuple[scene.Window, Pixels]:
    """Data window and pixels (height, width, 3), as float32, of an EXR file."""
    with OpenEXR.File(io.BytesIO(exr)) as file:
        header = file.header()
        channels = file.channels()
        pixels = channels["RGB"].pixels if "RGB" in channels else np.stack([channels[c].pixels for c in "RGB"], -1)
        low, high = header["dataWindow"]
        window = scene.Window(
            x=int(low[0]), y=int(low[1]), width=int(high[0] - low[0] + 1), height=int(high[1] - low[1] + 1)
        )
        return window, np.asarray(pixels).astype(np.float32)


def probe_requests(
    name: str, points: Points, settings: probe.ProbeSettings | None = None, chunk: int = 256
) -> Iterator[probe.ProbeRequest]:
    """The messages of a Probe stream."""
    yield probe.ProbeRequest(header=probe.ProbeHeader(scene=name, settings=settings))
    for start in range(0, len(points), chunk):
        coordinates = points[start : start + chunk].ravel()
        yield probe.ProbeRequest(points=probe.ProbePoints(coordinates=coordinates))


class Canvas:
    """Applies tiles as the wire contract says: the newest pixels of a window replace what was there."""

    def __init__(self) -> None:
        """Empty until the first snapshot."""
        self.window: scene.Window | None = None
        self.pixels = np.zeros((0, 0, 3), np.float32)

    def begin(self, window: scene.Window) -> None:
        """Takes the job's window; what is there stays when a stream is opened again."""
        if self.window is None:
            self.window = window
            self.pixels = np.full((window.height, window.width, 3), np.nan, np.float32)
        assert self.window == window

    def apply(self, tile: render.Tile) -> None:
        """Puts a tile in its place."""
        window, pixels = decode(tile.exr)
        assert window == tile.window
        assert self.window is not None
        x, y = window.x - self.window.x, window.y - self.window.y
        self.pixels[y : y + window.height, x : x + window.width] = pixels


class Server:
    """A fogbankd process."""

    def __init__(
        self,
        data: Path,
        *arguments: str,
        listen: str = "127.0.0.1:0",
        binary: Path | None = None,
        environment: Mapping[str, str] | None = None,
        descriptors: int | None = None,
        within: Sequence[str] = (),
    ) -> None:
        """Starts it and waits until it is ready.

        `descriptors` limits those that it may have open; `within` is a command that becomes the server, elsewhere.
        """
        self.data = data
        data.mkdir(parents=True, exist_ok=True)
        port_file = data / "port"
        port_file.unlink(missing_ok=True)
        self.log_path = data / "log"
        limit = () if descriptors is None else ("prlimit", f"--nofile={descriptors}:{descriptors}")
        command: list[str | Path] = [*within, *limit, binary or server_binary(), "--listen", listen, "--data", data]
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                [*command, "--port-file", port_file, *arguments],
                stdin=subprocess.PIPE,
                stderr=log,
                env={**os.environ, **(environment or {})},
            )
        end = time.monotonic() + PATIENCE_SECONDS
        while not port_file.exists():
            assert self.process.poll() is None, f"fogbankd ended: {self.log_path.read_text()}"
            assert time.monotonic() < end, "fogbankd is not ready"
            time.sleep(0.01)
        self.target = port_file.read_text().strip()
        self.connect()

    def connect(self) -> None:
        """A channel of its own, with the options that the server asks for."""
        self._bind(grpc.insecure_channel(self.target, options=list(CHANNEL_OPTIONS)))

    def _bind(self, channel: grpc.Channel) -> None:
        self.channel = channel
        self.scenes = SceneServiceStub(channel)
        self.render = RenderServiceStub(channel)
        self.probe = ProbeServiceStub(channel)
        self.caches = CacheServiceStub(channel)
        self.farm = FarmServiceStub(channel)
        self.flatland = FlatlandServiceStub(channel)
        self.server = ServerServiceStub(channel)

    def seen_through(self, channel: grpc.Channel) -> Server:
        """The same process, called over another channel."""
        other = copy.copy(self)
        other._bind(channel)
        return other

    def stop(self) -> int:
        """SIGTERM, and the exit code."""
        self.channel.close()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(PATIENCE_SECONDS)

    def kill(self) -> None:
        """SIGKILL, as a crash."""
        self.channel.close()
        self.process.kill()
        self.process.wait(PATIENCE_SECONDS)

    def job(self, name: str) -> render.Job:
        """A job as it is now."""
        return self.render.GetJob(render.GetJobRequest(name=name)).job

    def limit(self, name: str) -> float:
        """A limit by GetCapabilities."""
        capabilities = self.server.GetCapabilities(server.GetCapabilitiesRequest())
        return next(limit.value for limit in capabilities.limits if limit.name == name)

    def upload(self, data: bytes, *, chunk_bytes: int = CHUNK_BYTES) -> str:
        """Uploads a blob; its hash."""
        digest = sha256(data)

        def messages() -> Iterator[scene.UploadBlobRequest]:
            yield scene.UploadBlobRequest(header=scene.UploadBlobHeader(sha256=digest, size=len(data), offset=0))
            for start in range(0, len(data), chunk_bytes):
                yield scene.UploadBlobRequest(chunk=data[start : start + chunk_bytes])

        assert self.scenes.UploadBlob(messages()).committed_size == len(data)
        return digest

    def manifest(self, files: Mapping[str, bytes], main: str = "scene.xml") -> scene.SceneManifest:
        """A manifest of these files."""
        entries = [scene.ManifestEntry(path=path, sha256=sha256(data), size=len(data)) for path, data in files.items()]
        return scene.SceneManifest(main_path=main, entries=entries)

    def create_scene(self, files: Mapping[str, bytes] | bytes) -> scene.Scene:
        """Uploads and loads a scene; bytes alone are its main file."""
        if isinstance(files, bytes):
            files = {"scene.xml": files}
        for data in files.values():
            self.upload(data)
        request = scene.CreateSceneRequest(request_id=new_request_id(), manifest=self.manifest(files))
        return self.scenes.CreateScene(request).scene

    def create_job(
        self, name: str, settings: render.RenderSettings | None = None, *, leased: bool = False
    ) -> render.Job:
        """Creates a job."""
        request = render.CreateJobRequest(request_id=new_request_id(), scene=name, settings=settings, leased=leased)
        return self.render.CreateJob(request).job

    def watch(self, name: str, canvas: Canvas | None = None, since: int = 0) -> render.Job:
        """Watches a job to its end, checking the order of events; the job at its end."""
        ended: render.Job | None = None
        first = True
        revision = 0
        for event in self.render.WatchJob(render.WatchJobRequest(name=name, since_revision=since)):
            kind = event.WhichOneof("event")
            assert ended is None, f"{kind} after the terminal event"
            assert (kind == "snapshot") == first
            first = False
            assert event.revision >= revision
            revision = event.revision
            if kind == "snapshot" and canvas is not None:
                canvas.begin(event.snapshot.window)
            if kind == "tile" and canvas is not None:
                canvas.apply(event.tile)
            if kind == "ended":
                ended = event.ended.job
        assert ended is not None, "the stream ended without a terminal event"
        return ended

    def finish(self, name: str) -> render.Job:
        """Waits for a job; it must succeed."""
        job = self.watch(name)
        assert job.state == render.JOB_STATE_SUCCEEDED, job.error
        return job

    def download(self, name: str, offset: int = 0) -> bytes:
        """The final EXR from `offset` on, checked against its hash when it is whole."""
        data = b""
        digest = ""
        for message in self.render.DownloadImage(render.DownloadImageRequest(name=name, offset=offset)):
            assert message.offset == offset + len(data)
            assert len(message.chunk) <= 256 << 10
            data += message.chunk
            digest = message.sha256
            size = message.size
        assert offset + len(data) == size
        if offset == 0:
            assert sha256(data) == digest
        return data

    def image(self, name: str) -> Pixels:
        """Pixels of the final image."""
        return decode(self.download(name))[1]

    def probe_points(
        self, name: str, points: Points, settings: probe.ProbeSettings | None = None, *, chunk: int = 256
    ) -> list[probe.ProbeResults]:
        """Results of all points, sent in chunks of this length, checked for their order."""
        responses = self.probe.Probe(probe_requests(name, points, settings, chunk))
        assert next(responses).HasField("started")
        results = [response.results for response in responses]
        answered = 0
        for result in results:
            assert result.first_point == answered
            answered += len(result.medium_index)
        assert answered == len(points)
        return results

    def fill(
        self,
        name: str,
        settings: render.RenderSettings | None = None,
        cameras: Sequence[render.CameraOverride] = (),
    ) -> cache.FillCacheResponse:
        """Fills the cache of a scene, checking what it reports; the last report."""
        last: cache.FillCacheResponse | None = None
        for report in self.caches.FillCache(cache.FillCacheRequest(scene=name, settings=settings, cameras=cameras)):
            assert last is None or not last.done, "a report after the last one"
            assert last is None or report.records_new >= last.records_new
            assert report.cameras_total == max(1, len(cameras))
            last = report
        assert last is not None
        assert last.done
        return last

    def export(self, name: str) -> bytes:
        """A cache as a file, checked against its hash."""
        data = b""
        for response in self.caches.ExportCache(cache.ExportCacheRequest(name=name)):
            assert response.chunk.offset == len(data)
            data += response.chunk.data
        assert response.chunk.size == len(data)
        assert response.chunk.sha256 == sha256(data)
        return data

    def import_cache(self, data: bytes, name: str = "") -> cache.ImportCacheResponse:
        """Uploads and imports an exported file."""
        return self.caches.ImportCache(cache.ImportCacheRequest(sha256=self.upload(data), cache=name))

    def merge(self, *files: bytes) -> bytes:
        """The union of exported files."""
        request = cache.MergeCachesRequest(sha256s=[self.upload(data) for data in files])
        return b"".join(response.chunk.data for response in self.caches.MergeCaches(request))

    def cpu_seconds(self) -> float:
        """CPU time of the process so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
