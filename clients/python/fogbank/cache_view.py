"""A cache seen from above: what its picture is drawn from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import grpc
import numpy as np
import numpy.typing as npt

from fogbank._generated.v1 import cache_pb2
from fogbank.channel import Connection
from fogbank.errors import FogbankError, UnavailableError
from fogbank.retry import Backoff

FloatArray = npt.NDArray[np.float32]
Quantity: TypeAlias = Literal["rest", "irradiance", "ratio", "unaware-rest", "unaware-direct", "directional-rest"]

_QUANTITIES: dict[int, Quantity] = {
    cache_pb2.RECORD_QUANTITY_REST: "rest",
    cache_pb2.RECORD_QUANTITY_IRRADIANCE: "irradiance",
    cache_pb2.RECORD_QUANTITY_RATIO: "ratio",
    cache_pb2.RECORD_QUANTITY_UNAWARE_REST: "unaware-rest",
    cache_pb2.RECORD_QUANTITY_UNAWARE_DIRECT: "unaware-direct",
    cache_pb2.RECORD_QUANTITY_DIRECTIONAL_REST: "directional-rest",
}


@dataclass(frozen=True)
class CacheComponent:
    """The records of a cache that describe one part of the light field."""

    quantity: Quantity | None
    """What their value is; None for one that this version of the client does not know."""

    medium: int
    """Index of the medium that holds them, in the order of the scene file."""

    light_group: int
    """Group of lights that it counts; of ratios the number of the light."""

    generation: int
    """Generation of the records that the values were gathered from: 0 for paths alone."""

    records: int
    """Number of records."""

    @classmethod
    def from_message(cls, message: cache_pb2.CacheComponent) -> CacheComponent:
        """The component of a wire message."""
        return cls(
            quantity=_QUANTITIES.get(message.quantity),
            medium=message.medium,
            light_group=message.light_group,
            generation=message.generation,
            records=message.records,
        )


@dataclass(frozen=True)
class Plan:
    """A scene cut open at a height and seen from above, as an architect draws it."""

    depth: FloatArray
    """(height, width): how far below the cut the first surface is, scene units; infinite where there is none."""

    facing: FloatArray
    """(height, width): cosine between that surface's normal and the up axis, 0 to 1."""

    solid: npt.NDArray[np.bool_]
    """(height, width): whether the cut goes through a solid object there."""

    axes: tuple[int, int, int]
    """World axes that point to the right, down, and to the viewer: 0, 1, 2 for x, y, z."""

    extent: tuple[float, float, float, float]
    """World coordinates of the left, right, lower and upper border, the last two along the axis that points down."""

    cut: float
    """World coordinate along the up axis at which the scene is cut."""


@dataclass(frozen=True)
class RecordExtents:
    """The records of one component with their extents."""

    component: CacheComponent
    """The component."""

    positions: FloatArray
    """(n, 3): places that hold records, mostly one each; world space."""

    semi_axes: FloatArray
    """(n, 3, 3): of each place's ellipsoid three vectors, the longest first, the third 0 on surfaces; scene units."""

    @property
    def radii(self) -> FloatArray:
        """(n,): radius of the ball of the same volume, on surfaces of the disk of the same area; scene units."""
        lengths = np.linalg.norm(self.semi_axes, axis=-1)
        flat = lengths[:, 2] <= 0.0
        ball = np.cbrt(np.prod(lengths, axis=-1))
        radii: FloatArray = np.where(flat, np.sqrt(lengths[:, 0] * lengths[:, 1]), ball).astype(np.float32)
        return radii


@dataclass(frozen=True)
class CacheView:
    """Plan and records."""

    plan: Plan
    """The scene from above."""

    records: list[RecordExtents]
    """By component."""


def view_cache(connection: Connection, request: cache_pb2.ViewCacheRequest) -> CacheView:
    """Fetches a view; a broken stream is begun anew."""
    backoff = Backoff(connection.retry_policy)
    while True:
        try:
            return _assemble(connection.stubs.caches.ViewCache(request))
        except grpc.RpcError as rpc_error:
            error: FogbankError = connection.translate(rpc_error)
        except EOFError:
            error = UnavailableError("the view broke off")
        connection.wait_or_raise(backoff, error)


def _assemble(responses: Iterator[cache_pb2.ViewCacheResponse]) -> CacheView:
    plan: cache_pb2.PlanView | None = None
    depth: list[FloatArray] = []
    facing: list[FloatArray] = []
    solid: list[bytes] = []
    parts: dict[bytes, tuple[CacheComponent, list[FloatArray], list[FloatArray]]] = {}
    missing = 0
    for response in responses:
        if response.HasField("plan"):
            plan = response.plan
            continue
        if response.HasField("rows"):
            depth.append(np.array(response.rows.depth, np.float32))
            facing.append(np.array(response.rows.facing, np.float32))
            solid.append(response.rows.solid)
            continue
        message = response.records
        key = message.component.SerializeToString(deterministic=True)
        if key not in parts:
            parts[key] = CacheComponent.from_message(message.component), [], []
            missing += message.places
        _, positions, semi_axes = parts[key]
        positions.append(np.array(message.positions, np.float32).reshape(-1, 3))
        missing -= len(positions[-1])
        semi_axes.append(np.array(message.semi_axes, np.float32).reshape(-1, 3, 3))
    if plan is None or missing != 0 or sum(map(len, solid)) != plan.width * plan.height:
        raise EOFError
    records = [
        RecordExtents(component, np.concatenate(positions), np.concatenate(semi_axes))
        for component, positions, semi_axes in parts.values()
    ]
    shape = (plan.height, plan.width)
    return CacheView(
        Plan(
            depth=np.concatenate(depth).reshape(shape),
            facing=np.concatenate(facing).reshape(shape),
            solid=np.frombuffer(b"".join(solid), np.uint8).reshape(shape) != 0,
            axes=(plan.right_axis, plan.down_axis, plan.up_axis),
            extent=(
                plan.left,
                plan.left + plan.width * plan.pixel_size,
                plan.top + plan.height * plan.pixel_size,
                plan.top,
            ),
            cut=plan.cut,
        ),
        records,
    )
