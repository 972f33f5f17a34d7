"""Radiance at points of space, with its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

import numpy as np
import numpy.typing as npt

from fogbank._generated.v1 import probe_pb2
from fogbank.errors import InvalidArgumentError

FloatArray = npt.NDArray[np.float64]
PointsLike = npt.ArrayLike
Order = Literal["single", "multiple", "both"]


class ProbeOptions(TypedDict, total=False):
    """Everything that `Scene.probe` takes besides points; what is left out (or None) is the default."""

    method: str | None
    """One of `Service.capabilities.probe_methods`; "aware" by default."""

    order: Order | None
    """Which light is counted, by where the last stretch of its way to the point begins: "single": on a surface, an
    emitter or an environment; "multiple": in the medium; "both" (the default): everything."""

    derivatives: Literal["value", "gradient", "hessian"] | None
    """Up to which order derivatives are computed; "hessian" by default. What is left out costs nothing."""

    samples: int | None
    """Directions of one estimate's sphere; 1024 by default."""

    repeats: int | None
    """Independent estimates whose mean is the result and whose spread is the standard error; 4 by default. With 1 the
    standard errors are 0, for unknown."""

    max_depth: int | None
    """Greatest path length in edges; the edge from a camera to the point counts. -1 for no limit; the scene's by
    default."""

    bisect: bool | None
    """Finds silhouettes between neighbouring directions by bisection; on by default."""

    sliding: bool | None
    """Adds the term of outlines that slide over the lit surface to the Hessian; on by default."""

    corners: bool | None
    """Adds the term of corners where outlines cross to the Hessian; on by default."""

    seed: int | None
    """Seed of the random numbers, 0 to 2**64 - 1; 0 by default."""


_ORDERS = {
    "single": probe_pb2.PROBE_ORDER_SINGLE,
    "multiple": probe_pb2.PROBE_ORDER_MULTIPLE,
    "both": probe_pb2.PROBE_ORDER_BOTH,
}
_DERIVATIVES = {
    "value": probe_pb2.PROBE_DERIVATIVES_VALUE,
    "gradient": probe_pb2.PROBE_DERIVATIVES_GRADIENT,
    "hessian": probe_pb2.PROBE_DERIVATIVES_HESSIAN,
}
_CHOICES: dict[str, dict[str, Any]] = {"order": _ORDERS, "derivatives": _DERIVATIVES}


class ProbeField:
    """Radiance and luminance at n points as Taylor expansions: f(x + d) = f + gradient @ d + d @ hessian @ d / 2.

    Radiance is linear Rec. 709 in the scene's own unit (W / m^2 / sr for scenes in SI units), gradients are per scene
    unit of length u, Hessians per u^2. Derivatives that were not asked for raise ValueError.
    """

    def __init__(self, arrays: dict[str, FloatArray]) -> None:
        """Made by `Scene.probe`, not by users; `arrays` are those that were computed, by their names here."""
        self.arrays = arrays

    @property
    def radiance(self) -> FloatArray:
        """(n, 3): r, g, b."""
        return self._get("radiance")

    @property
    def gradient(self) -> FloatArray:
        """(n, 3, 3): [point, channel, axis], 1 / u."""
        return self._get("gradient")

    @property
    def hessian(self) -> FloatArray:
        """(n, 3, 3, 3): [point, channel, axis, axis], symmetric, 1 / u^2."""
        return self._get("hessian")

    @property
    def luminance(self) -> FloatArray:
        """(n,): relative luminance, the Rec. 709 weights applied to r, g, b."""
        return self._get("luminance")

    @property
    def luminance_gradient(self) -> FloatArray:
        """(n, 3): [point, axis], 1 / u."""
        return self._get("luminance_gradient")

    @property
    def luminance_hessian(self) -> FloatArray:
        """(n, 3, 3): [point, axis, axis], symmetric, 1 / u^2."""
        return self._get("luminance_hessian")

    def _get(self, name: str) -> FloatArray:
        array = self.arrays.get(name)
        if array is None:
            raise ValueError(f"{name} was not computed: ask for derivatives={name.rpartition('_')[2]!r}")
        return array


class ProbeResult(ProbeField):
    """What a probe found at n points: mean incoming radiance (fluence / 4 pi) with derivatives, and how sure it is."""

    def __init__(
        self,
        arrays: dict[str, FloatArray],
        *,
        position: FloatArray,
        standard_error: ProbeField,
        samples: npt.NDArray[np.uint64],
        seconds: FloatArray,
        medium: npt.NDArray[np.int32],
        media: tuple[str, ...],
    ) -> None:
        """Made by `Scene.probe`, not by users."""
        super().__init__(arrays)
        self.position = position
        """(n, 3): the points as they were given; computed at the nearest 32-bit floats."""
        self.standard_error = standard_error
        """The standard error of every number; the same shapes."""
        self.samples = samples
        """(n,): rays traced."""
        self.seconds = seconds
        """(n,): CPU seconds of the thread that computed it; the only array that differs from run to run."""
        self.medium = medium
        """(n,): index into `media` of the medium that holds the point, -1 for none."""
        self.media = media
        """Ids of the scene's media."""

    def __len__(self) -> int:
        """Number of points."""
        return len(self.position)


@dataclass(frozen=True)
class PlanTerm:
    """One term of light transport, or one step of its computation, in the plan of a scene."""

    term: str
    """Its name."""

    on: bool
    """True when the scene needs it."""

    reason: str
    """Why."""


def probe_settings(options: ProbeOptions) -> probe_pb2.ProbeSettings:
    """The wire form of the options.

    Raises TypeError for an unknown option and InvalidArgumentError, naming the option, for a value that does not fit
    its type. Ranges are the server's business.
    """
    unknown = sorted(set(options) - set(ProbeOptions.__annotations__))
    if unknown:
        raise TypeError(f"probe() has no option {unknown[0]!r}")
    message = probe_pb2.ProbeSettings()
    for name, value in options.items():
        if value is None:
            continue
        field = {"field": f"settings.{name}"}
        choices = _CHOICES.get(name)
        if choices is not None and value not in choices:
            raise InvalidArgumentError(f"{name}: {value!r} is none of {', '.join(choices)}", metadata=field)
        try:
            setattr(message, name, value if choices is None else choices[str(value)])
        except (TypeError, ValueError) as error:
            raise InvalidArgumentError(f"{name}: {error}", metadata=field) from None
    return message


def probe_order(order: Order | None) -> probe_pb2.ProbeOrder.ValueType:
    """The wire form of an order."""
    return probe_settings({"order": order}).order


def gather(results: Sequence[ProbeResult]) -> ProbeResult:
    """One result of several; at least one."""
    first = results[0]

    def joined(fields: Sequence[ProbeField]) -> dict[str, FloatArray]:
        names = fields[0].arrays
        return {name: np.concatenate([field.arrays[name] for field in fields]) for name in names}

    return ProbeResult(
        joined(results),
        position=np.concatenate([result.position for result in results]),
        standard_error=ProbeField(joined([result.standard_error for result in results])),
        samples=np.concatenate([result.samples for result in results]),
        seconds=np.concatenate([result.seconds for result in results]),
        medium=np.concatenate([result.medium for result in results]),
        media=first.media,
    )


def point_array(points: PointsLike) -> FloatArray:
    """(n, 3) of points (n, 3) or one point (3,). Raises InvalidArgumentError for anything else."""
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"points: {error}", metadata={"field": "points"}) from None
    if array.shape == (3,):
        return array.reshape(1, 3)
    if array.shape == (0,):
        return np.zeros((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidArgumentError(f"points: shape {array.shape} is not (n, 3)", metadata={"field": "points"})
    return array


# Places of the packed upper triangle (xx, xy, xz, yy, yz, zz) in the whole symmetric matrix.
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


def result_from_message(
    message: probe_pb2.ProbeResults, points: FloatArray, settings: probe_pb2.ProbeSettings, media: tuple[str, ...]
) -> ProbeResult:
    """The results of `points`, computed with these settings."""
    return ProbeResult(
        _arrays(message.mean, len(points), settings),
        position=points,
        standard_error=ProbeField(_arrays(message.standard_error, len(points), settings)),
        samples=np.array(message.samples, dtype=np.uint64),
        seconds=np.array(message.seconds, dtype=np.float64),
        medium=np.array(message.medium_index, dtype=np.int32),
        media=media,
    )


def _arrays(field: probe_pb2.ProbeField, n: int, settings: probe_pb2.ProbeSettings) -> dict[str, FloatArray]:
    def array(values: Sequence[float], *shape: int) -> FloatArray:
        return np.array(values, dtype=np.float64).reshape(n, *shape)

    arrays = {"radiance": array(field.radiance, 3), "luminance": array(field.luminance)}
    if settings.derivatives == probe_pb2.PROBE_DERIVATIVES_VALUE:
        return arrays
    arrays |= {"gradient": array(field.gradient, 3, 3), "luminance_gradient": array(field.luminance_gradient, 3)}
    if settings.derivatives == probe_pb2.PROBE_DERIVATIVES_GRADIENT:
        return arrays
    return arrays | {
        "hessian": array(field.hessian, 3, 6)[..., _SYMMETRIC],
        "luminance_hessian": array(field.luminance_hessian, 6)[..., _SYMMETRIC],
    }
