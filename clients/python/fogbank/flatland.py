"""The two-dimensional model: radiance with its derivatives where the exact answer is known, too.

Scenes are files in the JSON form of the message `FlatlandScene` of proto/fogbank/v1/flatland.proto; scenes/flatland/
has some.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import numpy as np
from google.protobuf import json_format
from numpy.typing import ArrayLike, NDArray

from fogbank._generated.v1 import flatland_pb2
from fogbank._generated.v1.flatland_pb2 import FlatlandScene as FlatlandScene
from fogbank.channel import Connection
from fogbank.errors import InvalidSceneError

Method = Literal["exact", "unaware", "aware"]
Order = Literal["single", "multiple", "both"]

METHODS = {
    "exact": flatland_pb2.FLATLAND_METHOD_EXACT,
    "unaware": flatland_pb2.FLATLAND_METHOD_UNAWARE,
    "aware": flatland_pb2.FLATLAND_METHOD_AWARE,
}
ORDERS = {
    "single": flatland_pb2.FLATLAND_ORDER_SINGLE,
    "multiple": flatland_pb2.FLATLAND_ORDER_MULTIPLE,
    "both": flatland_pb2.FLATLAND_ORDER_BOTH,
}

# A call's answer comes as a whole; small calls keep a slow one from looking dead and may be interrupted between.
_POINTS_PER_CALL = 512


class FlatlandOptions(TypedDict, total=False):
    """How to compute; flatland.proto describes each, with its default."""

    samples: int
    seed: int
    bisections: int
    mean_rule: bool
    sliding: bool
    ratio: bool
    subtract: bool
    obliquity: bool
    march_step: float


PLAIN: FlatlandOptions = {
    "bisections": 0,
    "mean_rule": False,
    "sliding": False,
    "ratio": False,
    "subtract": False,
    "obliquity": False,
}
"""The options that make the aware method the plain scheme, without any correction."""


@dataclass(frozen=True)
class FlatlandEstimates:
    """Mean radiance M (fluence / 2 pi) at n points, with its derivatives; lengths are in scene units."""

    radiance: NDArray[np.float64]
    """(n,)"""

    gradient: NDArray[np.float64]
    """(n, 2)"""

    hessian: NDArray[np.float64]
    """(n, 2, 2), symmetric"""

    stratified_mean: NDArray[np.float64]
    """(n,); M from the same rays without triangulation"""

    rays: NDArray[np.uint64]
    """(n,)"""


def read_scene(path: str | os.PathLike[str]) -> FlatlandScene:
    """Reads a scene file; InvalidSceneError says what is wrong with its form. The server checks its numbers."""
    text = Path(path).read_text(encoding="utf-8")
    try:
        return json_format.Parse(text, FlatlandScene())
    except json_format.ParseError as error:
        raise InvalidSceneError(f"{os.fspath(path)}: {error}", reason="INVALID_SCENE") from None


def probe(
    connection: Connection,
    scene: FlatlandScene,
    points: ArrayLike,
    *,
    method: Method = "aware",
    order: Order = "both",
    **options: Unpack[FlatlandOptions],
) -> FlatlandEstimates:
    """What `Service.probe_flatland` does."""
    coordinates = np.asarray(points, dtype=np.float64)
    if coordinates.ndim != 2 or coordinates.shape[1] != 2:
        raise ValueError(f"points have the shape {coordinates.shape}; expected (n, 2)")
    for name, value, known in (("method", method, METHODS), ("order", order, ORDERS)):
        if value not in known:
            raise ValueError(f"{name} is {value!r}; expected one of {', '.join(known)}")
    settings = flatland_pb2.FlatlandSettings(method=METHODS[method], order=ORDERS[order], **options)
    responses = list(_responses(connection, scene, settings, coordinates))

    def joined(field: str, *shape: int) -> NDArray[np.float64]:
        parts = [np.asarray(getattr(response, field), dtype=np.float64) for response in responses]
        return np.concatenate([np.empty(0), *parts]).reshape(-1, *shape)

    xx, xy, yy = joined("hessian", 3).T
    return FlatlandEstimates(
        radiance=joined("radiance"),
        gradient=joined("gradient", 2),
        hessian=np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2),
        stratified_mean=joined("stratified_mean"),
        rays=joined("rays").astype(np.uint64),
    )


def _responses(
    connection: Connection,
    scene: FlatlandScene,
    settings: flatland_pb2.FlatlandSettings,
    coordinates: NDArray[np.float64],
) -> Iterator[flatland_pb2.ProbeFlatlandResponse]:
    for start in range(0, len(coordinates), _POINTS_PER_CALL):
        part = coordinates[start : start + _POINTS_PER_CALL].ravel().tolist()
        yield connection.call(
            lambda stubs: stubs.flatland.ProbeFlatland,
            flatland_pb2.ProbeFlatlandRequest(scene=scene, settings=settings, coordinates=part),
        )
