"""Fogbank: renders scenes in fog, as a service.

import fogbank
with fogbank.connect() as service:
    scene = service.load("scenes/shafts/shafts.xml")
    job = scene.render(integrator="volpath", spp=64)
    for tile in job.tiles():
        ...
    image = job.result()
    image.save("out.exr")
"""

import os

# Makes gRPC survive a fork, so that forked children can open channels of their own; read when grpc is imported.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "1")

from fogbank.cache import (
    Cache,
    CacheStatistics,
    FillProgress,
    GarbageReport,
    ImportReport,
    SceneCache,
    VerifyReport,
)
from fogbank.cache_view import CacheComponent, CacheView, Plan, RecordExtents
from fogbank.camera import CameraLike
from fogbank.camera_path import interpolate, orbit, read_keyframes
from fogbank.capabilities import Capabilities, Limit, QuotaUse, ServerStatus
from fogbank.comparison import compare
from fogbank.credentials import Credentials
from fogbank.errors import (
    AbortedError,
    AlreadyExistsError,
    CallCancelledError,
    DataLossError,
    DeadlineExceededError,
    FailedPreconditionError,
    FogbankError,
    InternalError,
    InvalidArgumentError,
    InvalidSceneError,
    JobCancelledError,
    JobFailedError,
    NotFoundError,
    PermissionDeniedError,
    ResourceExhaustedError,
    ServerStartError,
    UnauthenticatedError,
    UnavailableError,
    UnsupportedError,
)
from fogbank.flatland import FlatlandEstimates, FlatlandOptions, FlatlandScene
from fogbank.flatland_cache import FlatlandCache, FlatlandExtents
from fogbank.image import Image, to_srgb
from fogbank.job import Job, JobEvent
from fogbank.job_report import ErrorReport, JobState, Progress, RenderStatistics, TrueError
from fogbank.pixels import Tile, place
from fogbank.probe import PlanTerm, ProbeField, ProbeOptions, ProbeResult
from fogbank.retry import RetryPolicy
from fogbank.scene import Bounds, LoadTimes, RenderDefaults, Scene, SceneStatistics
from fogbank.service import Service, connect
from fogbank.settings import RenderOptions
from fogbank.tracing import trace
from fogbank.upload import UploadProgress
from fogbank.window import Window

__all__ = [
    "AbortedError",
    "AlreadyExistsError",
    "Bounds",
    "Cache",
    "CacheComponent",
    "CacheStatistics",
    "CacheView",
    "CallCancelledError",
    "CameraLike",
    "Capabilities",
    "Credentials",
    "DataLossError",
    "DeadlineExceededError",
    "ErrorReport",
    "FailedPreconditionError",
    "FillProgress",
    "FlatlandCache",
    "FlatlandEstimates",
    "FlatlandExtents",
    "FlatlandOptions",
    "FlatlandScene",
    "FogbankError",
    "GarbageReport",
    "Image",
    "ImportReport",
    "InternalError",
    "InvalidArgumentError",
    "InvalidSceneError",
    "Job",
    "JobCancelledError",
    "JobEvent",
    "JobFailedError",
    "JobState",
    "Limit",
    "LoadTimes",
    "NotFoundError",
    "PermissionDeniedError",
    "Plan",
    "PlanTerm",
    "ProbeField",
    "ProbeOptions",
    "ProbeResult",
    "Progress",
    "QuotaUse",
    "RecordExtents",
    "RenderDefaults",
    "RenderOptions",
    "RenderStatistics",
    "ResourceExhaustedError",
    "RetryPolicy",
    "Scene",
    "SceneCache",
    "SceneStatistics",
    "ServerStartError",
    "ServerStatus",
    "Service",
    "Tile",
    "TrueError",
    "UnauthenticatedError",
    "UnavailableError",
    "UnsupportedError",
    "UploadProgress",
    "VerifyReport",
    "Window",
    "compare",
    "connect",
    "interpolate",
    "orbit",
    "place",
    "read_keyframes",
    "to_srgb",
    "trace",
]
