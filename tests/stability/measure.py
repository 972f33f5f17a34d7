"""Errors of the closed forms, in float and double, against high-precision answers."""

import json
import math
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from mpmath import mp, mpf

from tests.bench.engines import BINARIES, ROOT
from tests.numerics import make_vectors as exact
from tests.stability.cases import Family, Json

EPSILON = {"float": 2.0**-23, "double": 2.0**-52}
SMALLEST = {"float": 2.0**-126, "double": 2.0**-1022}
QUANTITIES = ("value", "gradient", "hessian")


@dataclass(frozen=True)
class Row:
    """The worst of a family's shapes at one parameter in one precision."""

    family: str
    parameter: float
    precision: str
    errors: tuple[float, float, float]  # of value, gradient, Hessian, relative; NaN where no answer exists
    forms: tuple[str, ...]
    is_finite: bool
    is_wrong_sign: bool

    @property
    def worst_error(self) -> float:
        return max((error for error in self.errors if not math.isnan(error)), default=0.0)

    @property
    def digits_lost(self) -> float:
        return max(0.0, math.log10(max(self.worst_error / EPSILON[self.precision], 1.0)))


def evaluate(cases: Sequence[Json]) -> list[Json]:
    """What the engine's closed forms make of the cases."""
    completed = subprocess.run(
        [str(BINARIES / "stability_evaluate")],
        input=json.dumps(cases),
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        check=True,
    )
    answers: list[Json] = json.loads(completed.stdout)
    return answers


def truth(case: Json) -> Json | None:
    """Value and derivatives to all digits of a double; None where derivatives don't exist or everything is 0."""
    kind = case["kind"]
    if kind == "batch":
        return batch_truth(case)
    point = exact.exact(case["point"])
    vertices = [exact.exact(vertex) for vertex in case["vertices"]]
    if kind in ("triangle", "segment"):
        form_factor = exact.triangle_form_factor if kind == "triangle" else exact.segment_form_factor
        distance = exact.distance_to_edges(point, vertices)
        if distance == 0 or form_factor(point, vertices) == 0:
            return None
        return exact.with_derivatives(lambda x: form_factor(x, vertices), point, distance)
    field = exact.transmittance if kind == "transmittance" else exact.transmittance_integral
    sigma_t = mpf(case["sigma_t"])
    distance = exact.length(exact.subtract(vertices[0], point))
    # Digits for second differences of what changes by 1e-300 of itself.
    with mp.workdps(400):
        scale = min(distance, 1 / sigma_t) if sigma_t > 0 else distance
        return exact.with_derivatives(lambda x: field(sigma_t, x, vertices[0]), point, scale)


def batch_truth(case: Json) -> Json:
    """Radiance of the triangles under the mean rule: each vertex gets a third of each of its triangles."""
    origin = [mpf(0)] * 3
    sigma_t = mpf(case["sigma_t"])
    distances = [mpf(distance) for distance in case["distances"]]
    # Directions are unit vectors up to their rounding, which the distance makes good.
    vertices = [
        [d * component / exact.length(exact.exact(u)) for component in exact.exact(u)]
        for u, d in zip(case["directions"], distances, strict=True)
    ]

    def radiance(x: exact.Vector) -> mpf:
        # Weights are what arrives at the point itself.
        through = [
            mpf(weight) * mp.exp(sigma_t * (distance - exact.length(exact.subtract(vertex, x))))
            for weight, vertex, distance in zip(case["weights"], vertices, distances, strict=True)
        ]
        return mp.fsum(
            mp.fsum(through[i] for i in corners) / 3 * exact.triangle_form_factor(x, [vertices[i] for i in corners])
            for corners in case["triangles"]
        )

    return exact.with_derivatives(radiance, origin, min(distances))


def numbers(quantity: Any) -> list[float | None]:  # noqa: ANN401 - JSON
    return quantity if isinstance(quantity, list) else [quantity]


def relative_error(found: list[float | None], expected: list[float | None], smallest: float) -> float:
    """In the maximum norm; what is below `smallest` may come out as 0. Absolute where exactly nothing is expected."""
    pairs = [(f, e) for f, e in zip(found, expected, strict=True) if f is not None and e is not None]
    if len(pairs) < len(expected):
        return math.inf
    size = max(abs(e) for _, e in pairs)
    error = max(abs(f - e) for f, e in pairs)
    if size < smallest:
        return 0.0 if error <= 2 * smallest else math.inf
    return error / size if size > 0 else error


def is_wrong_sign(found: Json, expected: Json, errors: Sequence[float]) -> bool:
    """A value of the other sign that isn't rounding, or a gradient that points backwards."""
    if errors[0] > 1e-2 and found["value"] * expected["value"] < 0:
        return True
    return math.fsum(f * e for f, e in zip(found["gradient"], expected["gradient"], strict=True)) < 0


def is_opaque(case: Json, smallest: float) -> bool:
    """Whether the transmittance is no normal number."""
    if case["kind"] not in ("transmittance", "integral"):
        return False
    depth: float = case["sigma_t"] * math.dist(case["point"], case["vertices"][0])
    return depth > -math.log(smallest)


def measure(families: Iterable[Family], shapes: int) -> list[Row]:
    """One row a family, parameter and precision."""
    rows: list[Row] = []
    for family in families:
        parameters, cases = zip(*family.cases(shapes), strict=True)
        answers = evaluate(cases)
        truths = [truth(case) for case in cases]
        for parameter in family.parameters:
            places = [i for i, p in enumerate(parameters) if p == parameter]
            rows.extend(
                summary(family, parameter, precision, [(cases[i], answers[i][precision], truths[i]) for i in places])
                for precision in EPSILON
            )
    return rows


def summary(
    family: Family, parameter: float, precision: str, compared: Sequence[tuple[Json, Json, Json | None]]
) -> Row:
    worst = [math.nan] * len(QUANTITIES)
    is_finite = all(
        n is not None for _, found, _ in compared for quantity in QUANTITIES for n in numbers(found[quantity])
    )
    wrong_sign = False
    for case, found, expected in compared:
        if expected is None:
            continue
        smallest = SMALLEST[precision]
        errors = [relative_error(numbers(found[q]), numbers(expected[q]), smallest) for q in QUANTITIES]
        if family.is_value_absolute:
            errors[0] *= abs(expected["value"])
        if is_opaque(case, smallest):
            # By design nothing of an underflown transmittance is left, however large its derivatives would be.
            errors[1:] = [0.0 if not any(numbers(found[q])) else math.inf for q in QUANTITIES[1:]]
        worst = [e if math.isnan(w) else max(w, e) for w, e in zip(worst, errors, strict=True)]
        wrong_sign = wrong_sign or (is_finite and is_wrong_sign(found, expected, errors))
    forms = tuple(sorted({found["form"] for _, found, _ in compared if "form" in found}))
    return Row(family.name, parameter, precision, (worst[0], worst[1], worst[2]), forms, is_finite, wrong_sign)
