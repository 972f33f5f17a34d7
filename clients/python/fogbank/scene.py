"""Scenes that are loaded on a server."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Unpack

from fogbank._generated.v1 import probe_pb2, render_pb2, scene_pb2
from fogbank.cache import SceneCache
from fogbank.channel import Connection
from fogbank.job import Job
from fogbank.job_report import PRIORITIES, Priority
from fogbank.probe import (
    Order,
    PlanTerm,
    PointsLike,
    ProbeOptions,
    ProbeResult,
    gather,
    point_array,
    probe_order,
    probe_settings,
    result_from_message,
)
from fogbank.probe_stream import probe_stream
from fogbank.reference import upload_reference
from fogbank.settings import RenderOptions, settings_message
from fogbank.window import Window


@dataclass(frozen=True)
class SceneStatistics:
    """Counts and sizes of a scene."""

    triangles: int
    """Triangles, instances counted once."""

    shapes: int
    """Shapes."""

    lights: int
    """Light sources; an emitting mesh counts as one."""

    media: int
    """Participating media."""

    memory_bytes: int
    """Memory of the loaded scene."""

    file_bytes: int
    """Size of all its files."""


@dataclass(frozen=True)
class LoadTimes:
    """Wall-clock seconds of each stage of the most recent loading."""

    parse_seconds: float
    """XML."""

    meshes_seconds: float
    """Mesh files."""

    textures_seconds: float
    """Image files."""

    bvh_seconds: float
    """Acceleration structure."""

    total_seconds: float
    """The whole, everything included."""


@dataclass(frozen=True)
class RenderDefaults:
    """What a job renders when its options do not say otherwise: the scene file's own film and integrator."""

    size: tuple[int, int]
    """Width and height of the film in pixels."""

    crop: Window
    """The film's crop window; the whole film when it has none."""

    integrator: str
    """The integrator."""

    spp: int
    """Samples per pixel."""

    max_depth: int
    """Greatest path length in edges, -1 for no limit."""

    rr_depth: int
    """Path length from which Russian roulette ends paths."""

    camera_to_world: list[float]
    """16 numbers row by row: the camera looks along its +z axis, +y is up."""


@dataclass(frozen=True)
class Bounds:
    """A sphere around all surfaces of a scene."""

    center: tuple[float, float, float]
    """World space."""

    radius: float
    """In scene units; 0 for a scene without surfaces."""


@dataclass(frozen=True)
class SceneSource:
    """Where a scene's files lie on this machine."""

    manifest: scene_pb2.SceneManifest
    """What the scene was created from."""

    paths: Mapping[str, Path]
    """Of its files, by SHA-256."""


class Scene:
    """A loaded scene. It stays on the server when this object goes."""

    def __init__(
        self,
        connection: Connection,
        message: scene_pb2.Scene,
        *,
        loaded_now: bool = False,
        source: SceneSource | None = None,
    ) -> None:
        """Made by `Service.load` and `Service.scene`, not by users."""
        self._connection = connection
        self._message = message
        self._loaded_now = loaded_now
        self.source = source
        """Its files; None unless this program has loaded it."""

    def __repr__(self) -> str:
        """File and name."""
        return f"<fogbank.Scene {self.main_path} {self.name}>"

    @property
    def name(self) -> str:
        """The name on the server, "scenes/{fingerprint}"; the same for the same contents."""
        return self._message.name

    @property
    def main_path(self) -> str:
        """Path of the XML file below the scene's root."""
        return self._message.main_path

    @property
    def radiance_fingerprint(self) -> str:
        """Identifies the radiance field; scenes that share it differ in camera, film and integrator only."""
        return self._message.radiance_fingerprint

    @property
    def create_time(self) -> datetime:
        """When the server first loaded it, UTC."""
        return self._message.create_time.ToDatetime(UTC)

    @property
    def resident(self) -> bool:
        """True when it was in memory when this client last heard of it; else the next job loads it again."""
        return self._message.resident

    @property
    def load_seconds(self) -> float:
        """Wall-clock seconds that the server spent on loading it for this object; 0 when it was loaded before."""
        return self._message.load_times.total_seconds if self._loaded_now else 0.0

    @property
    def warnings(self) -> list[str]:
        """What the loader substituted or ignored, each with file, line and element."""
        return list(self._message.warnings)

    @property
    def statistics(self) -> SceneStatistics:
        """Counts and sizes."""
        message = self._message.statistics
        return SceneStatistics(
            triangles=message.triangles,
            shapes=message.shapes,
            lights=message.lights,
            media=message.media,
            memory_bytes=message.memory_bytes,
            file_bytes=message.file_bytes,
        )

    @property
    def load_times(self) -> LoadTimes:
        """What the most recent loading cost."""
        message = self._message.load_times
        return LoadTimes(
            parse_seconds=message.parse_seconds,
            meshes_seconds=message.meshes_seconds,
            textures_seconds=message.textures_seconds,
            bvh_seconds=message.bvh_seconds,
            total_seconds=message.total_seconds,
        )

    @property
    def defaults(self) -> RenderDefaults:
        """What a job renders when its options do not say otherwise."""
        message = self._message.defaults
        return RenderDefaults(
            size=(message.width, message.height),
            crop=Window.from_message(message.crop),
            integrator=message.integrator,
            spp=message.samples_per_pixel,
            max_depth=message.max_depth,
            rr_depth=message.rr_depth,
            camera_to_world=list(message.camera_to_world),
        )

    @property
    def bounds(self) -> Bounds:
        """How large it is and where."""
        message = self._message.bounds
        return Bounds(center=(message.x, message.y, message.z), radius=message.radius)

    @property
    def cache(self) -> SceneCache:
        """Its radiance cache, which scenes that differ in camera, film, integrator or brightness of lights share."""
        return SceneCache(self._connection, self._message.cache, self.name)

    def render(
        self, *, request_id: str | None = None, priority: Priority = "normal", **options: Unpack[RenderOptions]
    ) -> Job:
        """Starts a render and returns at once.

        Args:
            request_id: 1 to 64 characters of [A-Za-z0-9_-]; the same id with the same options gives the same job, so
                a program that crashed can take up its job again. A random one when None.
            priority: "interactive" when somebody looks at it while it is rendered, "background" when it can wait: the
                more urgent of a user's jobs go first, between tiles.
            options: see `fogbank.RenderOptions`; all are optional.

        Raises InvalidArgumentError, naming the option, for options that the server refuses, OSError for a reference
        that cannot be read, and ResourceExhaustedError when too many jobs are waiting.
        """
        return Job(self._connection, self.create_job(options, request_id=request_id, priority=priority))

    def create_job(
        self,
        options: RenderOptions,
        *,
        request_id: str | None,
        priority: Priority,
        leased: bool = False,
        fill_only: bool = False,
    ) -> render_pb2.Job:
        """As `render`, for parts of this package: the job's message.

        Args:
            options: as of `render`.
            request_id: as of `render`.
            priority: as of `render`.
            leased: others perform its tasks.
            fill_only: it makes records and no picture.
        """
        reference = options.get("reference")
        if reference is not None:
            options["reference"] = upload_reference(self._connection, reference)
        request = render_pb2.CreateJobRequest(
            request_id=request_id or uuid.uuid4().hex,
            scene=self.name,
            settings=settings_message(options),
            priority=PRIORITIES[priority],
            leased=leased,
            fill_only=fill_only,
        )
        return self._connection.call(lambda stubs: stubs.render.CreateJob, request).job

    @property
    def connection(self) -> Connection:
        """The channel to its server, for parts of this package."""
        return self._connection

    def probe(self, points: PointsLike, **options: Unpack[ProbeOptions]) -> ProbeResult:
        """Mean incoming radiance (fluence / 4 pi) at points, with gradient and Hessian.

        Args:
            points: (n, 3) or (3,), world space, in scene units; anywhere, inside a medium or not.
            options: see `fogbank.ProbeOptions`; all are optional.

        A point's result depends on scene, options and the point only, never on the other points. Holds the results of
        all points (about 1 KB each); `probe_stream` does not.

        Raises InvalidArgumentError, naming the option, or the point as points[i], for what the server refuses.
        """
        settings = probe_settings(options)
        array = point_array(points)
        results = list(probe_stream(self._connection, self.name, settings, [array]))
        return gather(results) if results else result_from_message(probe_pb2.ProbeResults(), array, settings, ())

    def probe_stream(self, points: Iterable[PointsLike], **options: Unpack[ProbeOptions]) -> Iterator[ProbeResult]:
        """As `probe`, for any number of points: yields results of up to 256 points at a time, in their order.

        Args:
            points: an iterable of points (3,) or of arrays of points (k, 3); taken from as results are taken, so that
                neither points nor results pile up.
            options: see `fogbank.ProbeOptions`; all are optional.

        Dropping the generator ends the work on the server. Raises as `probe`, points counted over the whole stream.
        """
        return probe_stream(self._connection, self.name, probe_settings(options), points)

    def plan(self, *, order: Order | None = None, max_depth: int | None = None) -> list[PlanTerm]:
        """Which terms of light transport records of the scene need, which are left out, and why.

        Args:
            order: which light they are to count, as in `fogbank.ProbeOptions`.
            max_depth: greatest path length in edges, -1 for no limit; the scene's by default.
        """
        request = probe_pb2.GetPlanRequest(scene=self.name, order=probe_order(order), max_depth=max_depth)
        response = self._connection.call(lambda stubs: stubs.probe.GetPlan, request)
        return [PlanTerm(term=term.term, on=term.on, reason=term.reason) for term in response.terms]

    def delete(self) -> None:
        """Makes the server forget the scene; running jobs keep what they use."""
        self._connection.call(
            lambda stubs: stubs.scenes.DeleteScene,
            scene_pb2.DeleteSceneRequest(name=self.name),
            # A retry could not tell its own success from a scene that never was.
            idempotent=False,
        )
