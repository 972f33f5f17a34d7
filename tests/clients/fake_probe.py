"""The fake server's answers to points: known functions of the position, so that every number's place can be checked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt
from fogbank._generated.v1 import probe_pb2

Array = npt.NDArray[np.float64]

METHOD = "aware"
MEDIA = ("fog", "")

# xx, xy, xz, yy, yz, zz: how the wire packs a symmetric matrix.
PACKED = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def expected(position: Array) -> dict[str, Array]:
    """All arrays of a field at points (n, 3); no two numbers are the same by accident."""
    n = len(position)
    channel = np.arange(3.0)
    axis = np.arange(3.0)
    shift = position.sum(axis=1)
    symmetric = np.minimum(axis[:, None], axis) * 10 + np.maximum(axis[:, None], axis)
    return {
        "radiance": shift[:, None] + 100 * channel,
        "gradient": shift[:, None, None] + 100 * channel[:, None] + axis + 0.25,
        "hessian": shift[:, None, None, None] + 100 * channel[:, None, None] + symmetric + 0.5,
        "luminance": shift + 300,
        "luminance_gradient": shift[:, None] + 300 + axis + 0.25,
        "luminance_hessian": np.broadcast_to(symmetric, (n, 3, 3)) + shift[:, None, None] + 300.5,
    }


def _field(position: Array, scale: float, settings: probe_pb2.ProbeSettings) -> probe_pb2.ProbeField:
    arrays = {name: scale * array for name, array in expected(position).items()}
    for name in ("hessian", "luminance_hessian"):
        arrays[name] = np.stack([arrays[name][..., row, column] for row, column in PACKED], axis=-1)
    if settings.derivatives == probe_pb2.PROBE_DERIVATIVES_GRADIENT:
        arrays = {name: array for name, array in arrays.items() if "hessian" not in name}
    if settings.derivatives == probe_pb2.PROBE_DERIVATIVES_VALUE:
        arrays = {name: arrays[name] for name in ("radiance", "luminance")}
    return probe_pb2.ProbeField(**{name: array.ravel() for name, array in arrays.items()})


def answers(
    header: probe_pb2.ProbeHeader, requests: Iterable[probe_pb2.ProbeRequest]
) -> Iterator[probe_pb2.ProbeResponse]:
    """As the contract has it, one message for each chunk."""
    yield probe_pb2.ProbeResponse(started=probe_pb2.ProbeStarted(settings=header.settings, media=MEDIA))
    first = 0
    for request in requests:
        position = np.array(request.points.coordinates).reshape(-1, 3)
        n = len(position)
        results = probe_pb2.ProbeResults(
            first_point=first,
            mean=_field(position, 1.0, header.settings),
            standard_error=_field(position, 0.5, header.settings),
            samples=range(first, first + n),
            seconds=[0.5] * n,
            # One medium after the other, and none.
            medium_index=[(first + i) % 3 - 1 for i in range(n)],
        )
        first += n
        yield probe_pb2.ProbeResponse(results=results)
