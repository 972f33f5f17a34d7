"""A connection to a server, and what can be asked of it."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Self, Unpack

from numpy.typing import ArrayLike

from fogbank import flatland, flatland_cache
from fogbank._generated.v1 import render_pb2, scene_pb2, server_pb2
from fogbank.cache import Cache, GarbageReport, ImportReport, collect_garbage, import_cache, list_caches, merge_caches
from fogbank.capabilities import Capabilities, ServerStatus
from fogbank.channel import Connection
from fogbank.credentials import Credentials
from fogbank.embedded import EmbeddedServer
from fogbank.errors import FogbankError, InvalidSceneError, scene_error
from fogbank.hash_cache import HashCache
from fogbank.job import Job
from fogbank.job_report import STATES, JobState
from fogbank.paths import cache_folder
from fogbank.retry import RetryPolicy
from fogbank.scene import Scene, SceneSource
from fogbank.scene_files import SceneFiles
from fogbank.upload import ProgressSink, push

ParameterValue = str | int | float | bool


def connect(
    address: str | None = None,
    *,
    data: str | os.PathLike[str] | None = None,
    scene_root: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    credentials: Credentials | None = None,
    retry_policy: RetryPolicy | None = None,
) -> Service:
    """Connects to a server, by default to one that is started for the purpose and ends with this program.

    Args:
        address: "host:port" or "unix:/path" of a running server; None for an embedded one.
        data: data directory of the embedded server; None for $FOGBANK_DATA, else one in the user's cache folder.
        scene_root: folder below which the embedded server may read scenes by itself.
        threads: worker threads of the embedded server; None for one per core.
        credentials: for a server at `address` that asks who calls; None for those of the environment
            (`Credentials.from_environment`).
        retry_policy: how long to be patient with a server that cannot be reached.

    Raises UnavailableError when the server cannot be reached and ServerStartError when the embedded one does not
    come up.
    """
    if address is not None:
        if data is not None or scene_root is not None or threads is not None:
            raise TypeError("data, scene_root and threads are for the embedded server; give them or an address")
        credentials = credentials or Credentials.from_environment()
        return Service(Connection(address, credentials=credentials, retry_policy=retry_policy))
    server = EmbeddedServer(data=data, scene_root=scene_root, threads=threads)
    connection = Connection(server.target, retry_policy=retry_policy, explain_unavailable=server.failure)
    return Service(connection, server)


class Service:
    """A server. May be used from several threads, and again in forked children; a context manager that closes it."""

    def __init__(self, connection: Connection, server: EmbeddedServer | None = None) -> None:
        """Made by `connect`, not by users."""
        self._connection = connection
        self._server = server
        try:
            # Also finds out whether there is a server at all.
            self._capabilities = Capabilities.from_message(
                connection.call(lambda stubs: stubs.server.GetCapabilities, server_pb2.GetCapabilitiesRequest())
            )
            limit = self._capabilities.limits.get("max_upload_chunk_bytes")
            if limit is not None:
                connection.upload_chunk_bytes = min(connection.upload_chunk_bytes, int(limit.value))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """This object."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Closes the connection."""
        self.close()

    def close(self) -> None:
        """Ends the connection, and the server if it is embedded: its running jobs are cancelled."""
        self._connection.close()
        if self._server is not None:
            self._server.stop()

    @property
    def address(self) -> str:
        """Where the server listens."""
        return self._connection.target

    @property
    def embedded(self) -> bool:
        """True when the server ends with this object."""
        return self._server is not None

    @property
    def server_process_id(self) -> int | None:
        """Of the embedded server; None when the server is not embedded."""
        return None if self._server is None else self._server.process_id

    @property
    def connection(self) -> Connection:
        """The channel and its stubs, for parts of this package."""
        return self._connection

    @property
    def alive(self) -> bool:
        """False when the server is embedded and has died."""
        return self._server is None or self._server.failure() is None

    @property
    def capabilities(self) -> Capabilities:
        """What the server is and can do, as it said when the connection was made."""
        return self._capabilities

    def status(self) -> ServerStatus:
        """How busy the server is now."""
        return ServerStatus.from_message(
            self._connection.call(lambda stubs: stubs.server.GetServerStatus, server_pb2.GetServerStatusRequest())
        )

    def load(
        self,
        path: str | os.PathLike[str],
        *,
        parameters: Mapping[str, ParameterValue] | None = None,
        lenient: bool = False,
        root: str | os.PathLike[str] | None = None,
        on_progress: ProgressSink | None = None,
    ) -> Scene:
        """Loads a Mitsuba 3 XML scene; uploads those of its files that the server lacks.

        Args:
            path: the XML file.
            parameters: values for `$name` in the XML, replacing its defaults.
            lenient: substitutes what is not supported, with a warning each, instead of refusing the scene.
            root: folder that holds every file of the scene; the XML file's own when None. Files outside are not read.
            on_progress: told about every chunk that is uploaded, from another thread.

        Raises InvalidSceneError, naming file, line and element, for scenes that cannot be loaded.
        """
        options = _load_options(parameters, lenient)
        with closing(HashCache(cache_folder() / "hashes.sqlite")) as hash_cache:
            files = SceneFiles(Path(path), None if root is None else Path(root), hash_cache)
            try:
                manifest = push(self._connection, files, options, on_progress=on_progress)
                source = SceneSource(manifest, {file.sha256: file.path for file in files.files})
                return self._create_scene(scene_pb2.CreateSceneRequest(manifest=manifest), source)
            except InvalidSceneError as error:
                raise _with_advice(error, files.root) from None

    def load_server_file(
        self, path: str, *, parameters: Mapping[str, ParameterValue] | None = None, lenient: bool = False
    ) -> Scene:
        """Loads a scene that lies on the server's own machine, below its --scene-root; see `load`.

        Args:
            path: of the XML file, relative to the scene root, with '/' between the parts.
            parameters: as for `load`.
            lenient: as for `load`.
        """
        source = scene_pb2.ServerFile(path=path, options=_load_options(parameters, lenient))
        return self._create_scene(scene_pb2.CreateSceneRequest(server_file=source))

    def scene(self, name: str) -> Scene:
        """A scene by its name, "scenes/{fingerprint}"; NotFoundError when the server does not know it."""
        response = self._connection.call(lambda stubs: stubs.scenes.GetScene, scene_pb2.GetSceneRequest(name=name))
        return Scene(self._connection, response.scene)

    def scenes(self) -> Iterator[Scene]:
        """All scenes of the server, newest first."""
        token = ""
        while True:
            response = self._connection.call(
                lambda stubs: stubs.scenes.ListScenes,
                scene_pb2.ListScenesRequest(page_token=token),
            )
            for message in response.scenes:
                yield Scene(self._connection, message)
            token = response.next_page_token
            if not token:
                return

    def job(self, name: str) -> Job:
        """A job by its name, "jobs/{id}"; NotFoundError when the server does not know it."""
        response = self._connection.call(lambda stubs: stubs.render.GetJob, render_pb2.GetJobRequest(name=name))
        return Job(self._connection, response.job)

    def jobs(self, *, states: Iterable[JobState] = ()) -> Iterator[Job]:
        """All jobs of the server in one of `states` (all, if empty), newest first."""
        wanted = set(states)
        numbers = [number for number, state in STATES.items() if state in wanted]
        token = ""
        while True:
            response = self._connection.call(
                lambda stubs: stubs.render.ListJobs,
                render_pb2.ListJobsRequest(page_token=token, states=numbers),  # type: ignore[arg-type]
            )
            for message in response.jobs:
                yield Job(self._connection, message)
            token = response.next_page_token
            if not token:
                return

    def cache(self, name: str) -> Cache:
        """A cache by its name, "caches/{fingerprint}"; asks the server only when something is wanted of it."""
        return Cache(self._connection, name)

    def caches(self) -> Iterator[Cache]:
        """All caches of the server, by name."""
        return list_caches(self._connection)

    def import_cache(self, path: str | os.PathLike[str], *, on_progress: ProgressSink | None = None) -> ImportReport:
        """Adds the records of an exported file to the cache that it belongs to; the scene need not be known.

        Raises InvalidArgumentError for a file that is damaged or none of a cache, OSError when it cannot be read.
        """
        return import_cache(self._connection, Path(path), on_progress=on_progress)

    def merge_caches(self, paths: Iterable[str | os.PathLike[str]], output: str | os.PathLike[str]) -> None:
        """Writes the union of exported files of one scene as one file; their order does not matter.

        Raises FailedPreconditionError when they are not of one scene; the server's own caches are not touched.
        """
        merge_caches(self._connection, [Path(path) for path in paths], Path(output))

    def collect_cache_garbage(self, budget_bytes: int | None = None) -> GarbageReport:
        """Frees disk space of the server: joins files of caches, and removes the caches used least recently while all
        together take more than the budget (the server's own when None). Caches in use stay."""
        return collect_garbage(self._connection, budget_bytes)

    def probe_flatland(
        self,
        scene: flatland.FlatlandScene,
        points: ArrayLike,
        *,
        method: flatland.Method = "aware",
        order: flatland.Order = "both",
        **options: Unpack[flatland.FlatlandOptions],
    ) -> flatland.FlatlandEstimates:
        """Mean radiance with gradient and Hessian in the two-dimensional model.

        Args:
            scene: for example from `fogbank.flatland.read_scene`.
            points: (n, 2), inside the scene's box and off its surfaces.
            method: "exact" is the reference for the others.
            order: light from the segments ("single"), from the medium that they light ("multiple"), or from both.
            options: everything else that flatland.proto lists as a setting.
        """
        return flatland.probe(self._connection, scene, points, method=method, order=order, **options)

    def fill_flatland_cache(
        self,
        scene: flatland.FlatlandScene,
        points: ArrayLike,
        threshold: float,
        extents: flatland_cache.FlatlandExtents | None = None,
        *,
        method: flatland.Method = "aware",
        order: flatland.Order = "single",
        **options: Unpack[flatland.FlatlandOptions],
    ) -> flatland_cache.FlatlandCache:
        """Fills a radiance cache of the two-dimensional model until it reaches all points, and looks them up.

        Args:
            scene: as for `probe_flatland`.
            points: (n, 2) in the order in which they ask for records, inside the scene's box and off its surfaces.
            threshold: error to keep to, in the unit of the metric; > 0.
            extents: how far records are valid.
            method: how records are computed.
            order: of scattering, as for `probe_flatland`.
            options: as for `probe_flatland`.
        """
        return flatland_cache.fill(
            self._connection, scene, points, threshold, extents or {}, method=method, order=order, **options
        )

    def _create_scene(self, request: scene_pb2.CreateSceneRequest, source: SceneSource | None = None) -> Scene:
        request.request_id = uuid.uuid4().hex
        try:
            response = self._connection.call(lambda stubs: stubs.scenes.CreateScene, request)
        except FogbankError as error:
            raise scene_error(error) from None
        return Scene(self._connection, response.scene, loaded_now=not response.already_loaded, source=source)


def _with_advice(error: InvalidSceneError, root: Path) -> InvalidSceneError:
    """Adds what to do about references that leave the root."""
    if error.reason != "PATH_OUTSIDE_ROOT":
        return error
    return InvalidSceneError(
        f"{error.message}\nThe scene's root is {root}. If files outside it are meant, name a folder that holds all"
        " files of the scene as the root (root=... or --root).",
        reason=error.reason,
        metadata=error.metadata,
        code=error.code,
    )


def _load_options(parameters: Mapping[str, ParameterValue] | None, lenient: bool) -> scene_pb2.LoadOptions:
    texts = {
        # As Mitsuba spells truth values.
        name: str(value).lower() if isinstance(value, bool) else str(value)
        for name, value in (parameters or {}).items()
    }
    return scene_pb2.LoadOptions(parameters=texts, lenient=lenient)
