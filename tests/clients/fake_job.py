"""A job of the fake server: a picture that anyone can compute, rendered by a thread, tile by tile and pass by pass."""

from __future__ import annotations

import hashlib
import io
import threading
from collections.abc import Iterator
from typing import NoReturn

import grpc
import numpy as np
import numpy.typing as npt
import OpenEXR
from fogbank._generated.v1 import render_pb2, scene_pb2
from fogbank.window import Window
from google.protobuf import any_pb2
from google.rpc import error_details_pb2, status_pb2
from grpc_status import rpc_status

TILE_SIZE = 16
PASSES = 3

# Integrators of the fake server.
NORMAL, CACHED, ENDLESS, FAILING = "volpath", "radiance-cache", "endless", "failing"


def radiance(window: Window, pass_: int) -> npt.NDArray[np.float32]:
    """What the fake server "renders": shape (height, width, 3), different for each pixel, channel and pass."""
    rows, columns = np.mgrid[window.y : window.y + window.height, window.x : window.x + window.width]
    base = np.stack([rows + 0.25, columns + 0.5, rows * columns + 0.75], axis=-1)
    return (base * (1.0 - 2.0 ** -(pass_ + 1))).astype(np.float32)


def encode_exr(
    pixels: npt.NDArray[np.float32],
    window: Window,
    film: tuple[int, int],
    *,
    variance: bool = False,
    attributes: dict[str, str] | None = None,
) -> bytes:
    """An EXR file in memory, data window `window`, display window the film."""
    header = {
        "compression": OpenEXR.NO_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": (
            np.array([window.x, window.y], np.int32),
            np.array([window.x + window.width - 1, window.y + window.height - 1], np.int32),
        ),
        "displayWindow": (np.array([0, 0], np.int32), np.array([film[0] - 1, film[1] - 1], np.int32)),
        **(attributes or {}),
    }
    channels = {"RGB": np.ascontiguousarray(pixels)}
    if variance:
        for index, name in enumerate("RGB"):
            channels[f"variance.{name}"] = np.ascontiguousarray(pixels[..., index] * np.float32(0.01))
    file = io.BytesIO()
    OpenEXR.File(header, channels).write(file)
    return file.getvalue()


def status(code: int, reason: str, message: str, **metadata: str) -> status_pb2.Status:
    """A google.rpc.Status with an ErrorInfo, as Fogbank servers send."""
    detail = any_pb2.Any()
    detail.Pack(error_details_pb2.ErrorInfo(reason=reason, domain="fogbank", metadata=metadata))
    return status_pb2.Status(code=code, message=message, details=[detail])


def fail(context: grpc.ServicerContext, code: int, reason: str, message: str, **metadata: str) -> NoReturn:
    """Ends a call with an error."""
    context.abort_with_status(rpc_status.to_status(status(code, reason, message, **metadata)))


def report(passes_done: int) -> render_pb2.ErrorReport:
    """What a job with a cache says of its image after some passes; nothing of the noise after the first one."""
    message = render_pb2.ErrorReport(
        elapsed_seconds=0.1 * passes_done, samples_per_pixel=passes_done, records=42, epoch=3, bias=0.03
    )
    if passes_done > 1:
        message.noise = 0.04
        message.estimated_error = 0.05
    message.true_error.relative_mse = 0.001
    message.true_error.median = 0.01
    message.true_error.percentile_99 = 0.07
    return message


class FakeJob:
    """One job; its thread starts with `start`.

    Attributes:
        message: the job as GetJob shows it.
        image: the final EXR file, once it has succeeded.
        open_streams: WatchJob streams at this moment.
        go_on: cleared by tests to hold the render after the first pass.
    """

    def __init__(self, name: str, request: render_pb2.CreateJobRequest) -> None:
        """Fills in the defaults as a real server does."""
        settings = render_pb2.RenderSettings()
        settings.CopyFrom(request.settings)
        settings.integrator = settings.integrator or NORMAL
        if not settings.HasField("samples_per_pixel"):
            settings.samples_per_pixel = 4
        if not settings.HasField("width"):
            settings.width, settings.height = 40, 24
        if not settings.HasField("crop"):
            settings.crop.CopyFrom(scene_pb2.Window(x=0, y=0, width=settings.width, height=settings.height))
        self.message = render_pb2.Job(
            name=name,
            scene=request.scene,
            request_id=request.request_id,
            settings=settings,
            state=render_pb2.JOB_STATE_QUEUED,
        )
        self.message.create_time.GetCurrentTime()
        self.window = Window.from_message(settings.crop)
        self.film = (settings.width, settings.height)
        self.tiles = [
            Window(x, y, min(TILE_SIZE, self.window.x + self.window.width - x),
                   min(TILE_SIZE, self.window.y + self.window.height - y))
            for y in range(self.window.y, self.window.y + self.window.height, TILE_SIZE)
            for x in range(self.window.x, self.window.x + self.window.width, TILE_SIZE)
        ]  # fmt: skip
        self.image = b""
        self.open_streams = 0
        self.go_on = threading.Event()
        self.go_on.set()
        self._changed = threading.Condition()
        self._revision = 0
        self._tile_states: dict[int, tuple[int, int]] = {}  # index -> revision, pass
        self._progress_revision = 0

    def start(self) -> None:
        """Renders in a thread."""
        threading.Thread(target=self._render, daemon=True).start()

    def cancel(self) -> None:
        """Ends the job unless it has ended."""
        self._end(render_pb2.JOB_STATE_CANCELLED, status(1, "JOB_CANCELLED", "cancelled by a client"))

    @property
    def ended(self) -> bool:
        """True when nothing more happens."""
        return self.message.state >= render_pb2.JOB_STATE_SUCCEEDED

    def events(self, request: render_pb2.WatchJobRequest) -> Iterator[render_pb2.WatchJobResponse]:
        """What WatchJob sends: newest state of each tile, oldest change first."""
        with self._changed:
            self.open_streams += 1
        try:
            yield from self._events(request)
        finally:
            with self._changed:
                self.open_streams -= 1

    def _events(self, request: render_pb2.WatchJobRequest) -> Iterator[render_pb2.WatchJobResponse]:
        sent = request.since_revision
        sent_progress = request.since_revision
        with self._changed:
            snapshot = render_pb2.Snapshot(job=self.message, window=self.window.to_message())
        yield render_pb2.WatchJobResponse(revision=sent, snapshot=snapshot)
        while True:
            with self._changed:
                event = None
                newer = []
                if not request.without_tiles:
                    newer = sorted((rev, index) for index, (rev, _) in self._tile_states.items() if rev > sent)
                if newer:
                    sent, index = newer[0]
                    event = self._tile_event(sent, index, self._tile_states[index][1])
                elif self._progress_revision > sent_progress:
                    sent_progress = self._progress_revision
                    sent = max(sent, sent_progress) if request.without_tiles else sent
                    event = render_pb2.WatchJobResponse(revision=sent, progress=self.message.progress)
                elif self.ended:
                    event = render_pb2.WatchJobResponse(
                        revision=self._revision, ended=render_pb2.JobEnded(job=self.message)
                    )
                elif not self._changed.wait(0.2):
                    event = render_pb2.WatchJobResponse(revision=sent, heartbeat=render_pb2.Heartbeat())
            if event is not None:
                yield event
                if event.HasField("ended"):
                    return

    def _tile_event(self, revision: int, index: int, pass_: int) -> render_pb2.WatchJobResponse:
        window = self.tiles[index]
        tile = render_pb2.Tile(window=window.to_message(), samples_per_pixel=pass_ + 1)
        setattr(tile, "pass", pass_)  # a keyword in Python
        tile.exr = encode_exr(radiance(window, pass_), window, self.film)
        return render_pb2.WatchJobResponse(revision=revision, tile=tile)

    def _render(self) -> None:
        settings = self.message.settings
        with self._changed:
            if self.ended:
                return
            self.message.state = render_pb2.JOB_STATE_RUNNING
            self.message.start_time.GetCurrentTime()
            self._changed.notify_all()
        if settings.integrator == FAILING:
            self._end(render_pb2.JOB_STATE_FAILED, status(13, "INTERNAL_ERROR", "the fake integrator fails"))
            return
        pass_ = 0
        while pass_ < PASSES or settings.integrator == ENDLESS:
            for index in range(len(self.tiles)):
                with self._changed:
                    if self.ended:
                        return
                    self._revision += 1
                    self._tile_states[index] = (self._revision, min(pass_, PASSES - 1))
                    self._changed.notify_all()
                if settings.integrator == ENDLESS:
                    threading.Event().wait(0.002)
            self._note_progress(pass_ + 1)
            self.go_on.wait()
            pass_ += 1
        self._succeed()

    def _note_progress(self, passes_done: int) -> None:
        with self._changed:
            progress = self.message.progress
            progress.passes_done = passes_done
            progress.passes_total = PASSES
            progress.samples_per_pixel_done = passes_done
            progress.fraction = min(1.0, passes_done / PASSES)
            progress.rays = passes_done * 1000
            progress.rays_per_second = 1.5e6
            progress.elapsed_seconds = 0.1 * passes_done
            progress.eta_seconds = 0.1
            progress.phase = render_pb2.JOB_PHASE_RENDERING
            if self.message.settings.integrator == CACHED:
                progress.records_reused, progress.records_new, progress.epoch = 30, 12, 3
                progress.report.CopyFrom(report(passes_done))
            self._revision += 1
            self._progress_revision = self._revision
            self._changed.notify_all()

    def _succeed(self) -> None:
        settings = self.message.settings
        self.image = encode_exr(
            radiance(self.window, PASSES - 1),
            self.window,
            self.film,
            variance=settings.variance,
            attributes={"fogbank:scene": self.message.scene, "fogbank:seed": str(settings.seed)},
        )
        result = render_pb2.JobResult(
            window=self.window.to_message(),
            film_width=self.film[0],
            film_height=self.film[1],
            samples_per_pixel=settings.samples_per_pixel,
            samples=settings.samples_per_pixel * self.window.width * self.window.height,
            rays=3000,
            load_seconds=0.0,
            render_seconds=0.5,
            render_cpu_seconds=0.9,
            relative_noise=0.02,
            image_bytes=len(self.image),
            image_sha256=hashlib.sha256(self.image).hexdigest(),
        )
        if settings.integrator == CACHED:
            result.cache = "caches/" + "c" * 64
            result.records_reused, result.records_new, result.epoch = 30, 12, 3
            result.history.extend(report(number + 1) for number in range(PASSES))
        with self._changed:
            if not self.ended:
                self.message.result.CopyFrom(result)
        self._end(render_pb2.JOB_STATE_SUCCEEDED, None)

    def _end(self, state: render_pb2.JobState.ValueType, error: status_pb2.Status | None) -> None:
        with self._changed:
            if self.ended:
                return
            self.message.state = state
            self.message.end_time.GetCurrentTime()
            if error is not None:
                self.message.error.CopyFrom(error)
            self._revision += 1
            self.message.revision = self._revision
            self._changed.notify_all()
