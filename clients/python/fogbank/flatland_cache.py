"""The radiance cache of the two-dimensional model: filled where points ask for records, and looked up there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fogbank._generated.v1 import flatland_pb2
from fogbank.channel import Connection
from fogbank.flatland import METHODS, ORDERS, FlatlandOptions, FlatlandScene, Method, Order

Metric = Literal["second-order", "first-order"]
Shape = Literal["ellipse", "circle"]

METRICS = {
    "second-order": flatland_pb2.FLATLAND_METRIC_SECOND_ORDER,
    "first-order": flatland_pb2.FLATLAND_METRIC_FIRST_ORDER,
}
SHAPES = {
    "ellipse": flatland_pb2.FLATLAND_SHAPE_ELLIPSE,
    "circle": flatland_pb2.FLATLAND_SHAPE_CIRCLE,
}


class FlatlandExtents(TypedDict, total=False):
    """How far records are valid; flatland.proto describes each, with its default."""

    metric: Metric
    shape: Shape
    maximum_anisotropy: float
    maximum_radius: float
    minimum_radius: float
    neighbour_clamp: bool
    visibility_margin: bool
    verify: bool
    depth: bool
    pilot: int


@dataclass(frozen=True)
class FlatlandCache:
    """A filled cache of m records and what it says about n points; lengths are in scene units."""

    radiance: NDArray[np.float64]
    """(n,); mean radiance M, fluence / 2 pi"""

    positions: NDArray[np.float64]
    """(m, 2), of the records"""

    axis: NDArray[np.float64]
    """(m, 2); direction of the first semi-axis of each record's extent, unit length"""

    semi_axes: NDArray[np.float64]
    """(m, 2)"""

    rays: int
    """of all records"""


def fill(
    connection: Connection,
    scene: FlatlandScene,
    points: ArrayLike,
    threshold: float,
    extents: FlatlandExtents,
    *,
    method: Method,
    order: Order,
    **options: Unpack[FlatlandOptions],
) -> FlatlandCache:
    """What `Service.fill_flatland_cache` does."""
    coordinates = np.asarray(points, dtype=np.float64)
    if coordinates.ndim != 2 or coordinates.shape[1] != 2:
        raise ValueError(f"points have the shape {coordinates.shape}; expected (n, 2)")
    metric, shape = extents.get("metric", "second-order"), extents.get("shape", "ellipse")
    known: tuple[tuple[str, str, dict[str, object]], ...] = (
        ("method", method, {**METHODS}),
        ("order", order, {**ORDERS}),
        ("metric", metric, {**METRICS}),
        ("shape", shape, {**SHAPES}),
    )
    for name, value, values in known:
        if value not in values:
            raise ValueError(f"{name} is {value!r}; expected one of {', '.join(values)}")
    numbers = {name: value for name, value in extents.items() if name not in ("metric", "shape")}
    request = flatland_pb2.FillFlatlandCacheRequest(
        scene=scene,
        settings=flatland_pb2.FlatlandSettings(method=METHODS[method], order=ORDERS[order], **options),
        cache=flatland_pb2.FlatlandCacheSettings(
            metric=METRICS[metric],
            shape=SHAPES[shape],
            threshold=threshold,
            **numbers,  # type: ignore[arg-type]
        ),
        coordinates=coordinates.ravel().tolist(),
    )
    response = connection.call(lambda stubs: stubs.flatland.FillFlatlandCache, request)
    return FlatlandCache(
        radiance=np.asarray(response.radiance, dtype=np.float64),
        positions=np.asarray(response.record_coordinates, dtype=np.float64).reshape(-1, 2),
        axis=np.asarray(response.record_axis, dtype=np.float64).reshape(-1, 2),
        semi_axes=np.asarray(response.record_semi_axes, dtype=np.float64).reshape(-1, 2),
        rays=response.rays,
    )
