"""The stiff and extreme cases of the closed forms: families of configurations along one parameter."""

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from tests.numerics.make_vectors import direction

Json = dict[str, Any]
Point = list[float]


@dataclass(frozen=True)
class Family:
    """Configurations `make(parameter, shape)` for each parameter and for `shapes` random shapes."""

    name: str
    parameter: str  # what the parameter is, with its unit
    parameters: list[float]
    make: Callable[[float, random.Random], list[Json]]
    shapes: int = 4
    note: str = ""
    # Where float keeps two digits or more of everything, as a range of the parameter; beyond, double is due.
    float_is_enough: tuple[float, float] = (-math.inf, math.inf)
    # Largest relative error that double may have.
    double_error: float = 1e-12
    # A value that tends to 0 while its terms don't: its error counts absolutely.
    is_value_absolute: bool = False

    def cases(self, shapes: int) -> Iterator[tuple[float, Json]]:
        for parameter in self.parameters:
            for shape in range(min(shapes, self.shapes)):
                source = random.Random(f"{self.name} {shape}")
                for case in self.make(parameter, source):
                    yield parameter, case


def decades(first: int, last: int) -> list[float]:
    step = 1 if last > first else -1
    return [10.0**exponent for exponent in range(first, last + step, step)]


def triangle(point: Point, *vertices: Point) -> Json:
    return {"kind": "triangle", "point": point, "vertices": list(vertices)}


def scaled(vector: Point, factor: float) -> Point:
    return [factor * component for component in vector]


def combined(*terms: tuple[float, Point]) -> Point:
    return [math.fsum(factor * vector[axis] for factor, vector in terms) for axis in range(3)]


def single(number: float) -> float:
    """Rounded to 24 bits, as scene coordinates are, so that float starts from the same configuration."""
    mantissa, exponent = math.frexp(number)
    return math.ldexp(round(mantissa * 2**24), exponent - 24)


def rounded(vector: Point) -> Point:
    return [single(component) for component in vector]


def random_triangle(source: random.Random) -> list[Point]:
    """Corners about 1 apart, about 1.5 from the origin."""
    center = scaled(direction(source, 3), 1.5)
    return [rounded(combined((1.0, center), (0.7, direction(source, 3)))) for _ in range(3)]


def scale(factor: float, source: random.Random) -> list[Json]:
    return [triangle([0.0, 0.0, 0.0], *(rounded(scaled(v, factor)) for v in random_triangle(source)))]


def offset(distance: float, source: random.Random) -> list[Json]:
    corners = random_triangle(source)
    away = scaled(direction(source, 3), distance)
    return [triangle(rounded(away), *(rounded(combined((1.0, away), (1.0, v))) for v in corners))]


def near_edge(gap: float, source: random.Random) -> list[Json]:
    a, b, c = random_triangle(source)
    along = source.uniform(0.2, 0.8)
    foot = combined((1 - along, a), (along, b))
    return [triangle(combined((1.0, foot), (gap, direction(source, 3))), a, b, c)]


def near_vertex(gap: float, source: random.Random) -> list[Json]:
    a, b, c = random_triangle(source)
    return [triangle(combined((1.0, a), (gap, direction(source, 3))), a, b, c)]


def near_surface(gap: float, source: random.Random) -> list[Json]:
    side = 1.0 if source.random() < 0.5 else -1.0
    point = [source.uniform(0.2, 0.4), source.uniform(0.2, 0.4), side * gap]
    return [triangle(point, [0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.0])]


def near_plane_outside(gap: float, source: random.Random) -> list[Json]:
    point = [source.uniform(1.1, 2), source.uniform(1.1, 2), gap]
    return [triangle(point, [0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.0])]


def solid_angle(angle: float, source: random.Random) -> list[Json]:
    """Far and small: corners that differ by less than their rounding in float are told apart by the edges."""
    size = math.sqrt(angle)
    center = direction(source, 3)
    return [triangle([0.0, 0.0, 0.0], *(combined((1.0, center), (size, direction(source, 3))) for _ in range(3)))]


def blocker_before_light(ratio: float, source: random.Random) -> list[Json]:
    """One and two corners on a blocker at distance 1, the others on a light at distance `ratio`."""
    center = direction(source, 3)
    corners = [combined((1.0, center), (0.05, direction(source, 3))) for _ in range(3)]
    one = [corners[0], scaled(corners[1], ratio), scaled(corners[2], ratio)]
    two = [corners[0], corners[1], scaled(corners[2], ratio)]
    return [triangle([0.0, 0.0, 0.0], *(rounded(v) for v in vertices)) for vertices in (one, two)]


def sliver_short_edge(width: float, source: random.Random) -> list[Json]:
    a, b, _ = random_triangle(source)
    return [triangle([0.0, 0.0, 0.0], a, combined((1.0, a), (width, direction(source, 3))), b)]


def sliver_obtuse(height: float, source: random.Random) -> list[Json]:
    a, b, _ = random_triangle(source)
    middle = combined((0.5, a), (0.5, b), (height, direction(source, 3)))
    return [triangle([0.0, 0.0, 0.0], a, middle, b)]


def edge_on(elevation: float, source: random.Random) -> list[Json]:
    first, second, third = direction(source, 3), direction(source, 3), direction(source, 3)
    flat = combined((source.uniform(1, 2), first), (source.uniform(1, 2), second))
    return [triangle([0.0, 0.0, 0.0], first, second, combined((1.0, flat), (elevation, third)))]


def degenerate(kind: float, source: random.Random) -> list[Json]:
    """0: two corners coincide, 1: all do, 2: collinear, 3: the point is a corner, 4: on an edge, 5: inverted."""
    a, b, c = random_triangle(source)
    origin = [0.0, 0.0, 0.0]
    middle = scaled([x + y for x, y in zip(a, b, strict=True)], 0.5)
    return [
        [triangle(origin, a, a, b)],
        [triangle(origin, a, a, a)],
        [triangle(origin, a, middle, b)],
        [triangle(a, a, b, c)],
        [triangle(middle, a, b, c)],
        [triangle(origin, a, b, c), triangle(origin, b, a, c)],
    ][int(kind)]


def hemisphere(gap: float, source: random.Random) -> list[Json]:
    """The triangle all but fills the horizon: a point just above a light much larger than its distance."""
    corners = [[math.cos(angle), math.sin(angle), 0.0] for angle in (0.3, 2.4, 4.5)]
    return [triangle([0.1 * source.random(), 0.1, gap], *(rounded(v) for v in corners))]


def optical_depth(kind: str, size: float) -> Callable[[float, random.Random], list[Json]]:
    def make(depth: float, source: random.Random) -> list[Json]:
        vertex = rounded(scaled(direction(source, 3), size))
        return [{"kind": kind, "sigma_t": single(depth / size), "point": [0.0, 0.0, 0.0], "vertices": [vertex]}]

    return make


def coefficient_limit(kind: str) -> Callable[[float, random.Random], list[Json]]:
    def make(sigma_t: float, source: random.Random) -> list[Json]:
        vertex = rounded(direction(source, 3))
        return [{"kind": kind, "sigma_t": sigma_t, "point": [0.0, 0.0, 0.0], "vertices": [vertex]}]

    return make


def segment_near(gap: float, source: random.Random) -> list[Json]:
    point = [source.uniform(0.2, 0.8), gap]
    return [{"kind": "segment", "point": point, "vertices": [[0.0, 0.0], [1.0, 0.0]]}]


def segment_angle(angle: float, source: random.Random) -> list[Json]:
    first = source.uniform(-1, 1)
    return [{"kind": "segment", "point": [0.0, 0.0], "vertices": [[1.0, first], [1.0, first + angle]]}]


def batch(directions: list[Point], distances: list[float], triangles: list[list[int]], source: random.Random) -> Json:
    weights = [single(source.uniform(0.1, 1)) for _ in directions]
    return {
        "kind": "batch",
        "directions": directions,
        "distances": distances,
        "triangles": triangles,
        "weights": weights,
        "sigma_t": 0.5,
    }


def direction_grid(ratio: float, source: random.Random) -> list[Json]:
    """Closed surroundings, half of them `ratio` times as far as the rest, transmittance included."""
    directions = [
        [x / math.sqrt(3), y / math.sqrt(3), z / math.sqrt(3)] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)
    ]
    directions = [
        scaled(d, 1 / math.hypot(*d)) for d in (combined((1.0, d), (0.2, direction(source, 3))) for d in directions)
    ]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [[a, c, b] for a, b, c, _ in quads] + [[a, d, c] for a, _, c, d in quads]
    distances = [source.uniform(1, 2) * (ratio if source.random() < 0.5 else 1.0) for _ in directions]
    return [batch(directions, distances, triangles, source)]


def narrow_triangle(angle: float, source: random.Random) -> list[Json]:
    """One cell of a grid so fine that its directions differ by `angle`."""
    center = direction(source, 3)
    directions = [combined((1.0, center), (angle, direction(source, 3))) for _ in range(3)]
    directions = [scaled(d, 1 / math.hypot(*d)) for d in directions]
    distances = [source.uniform(1, 1 + angle) for _ in directions]
    return [batch(directions, distances, [[0, 1, 2]], source)]


FLOAT_LIMITS = [1.401298464324817e-45, 1.1754943508222875e-38, 1e-30, 1e-9, 1e9, 1e30, 3.4028234663852886e38]

FAMILIES = [
    Family("scale", "scene scale", [*decades(-15, -6)[::3], *decades(-6, 6), *decades(6, 15)[3::3]], scale),
    Family("offset", "distance from the origin / size", decades(0, 6), offset),
    Family("near edge", "distance to an edge / size", decades(-1, -9), near_edge, float_is_enough=(1e-5, 1)),
    Family("near vertex", "distance to a vertex / size", decades(-1, -9), near_vertex),
    Family("near surface", "distance to the surface / size", decades(-1, -9), near_surface),
    Family("near plane, outside", "distance to the plane / size", decades(-1, -9), near_plane_outside),
    Family("filled horizon", "distance to the light / size", decades(-1, -9), hemisphere),
    Family("small light", "solid angle (sr)", decades(0, -15), solid_angle),
    Family("blocker before light", "distance of light / blocker", decades(-3, 8), blocker_before_light),
    Family("sliver, short edge", "width / length", decades(-1, -12), sliver_short_edge),
    Family(
        "sliver, obtuse",
        "height / length",
        decades(-1, -12),
        sliver_obtuse,
        float_is_enough=(1e-5, 1),
        double_error=1e-4,
    ),
    Family("edge-on", "elevation (rad)", [*decades(-1, -15)[::2], 0.0], edge_on, is_value_absolute=True),
    Family("degenerate", "kind", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], degenerate, note=degenerate.__doc__ or ""),
    Family("batch, direction grid", "distance of half the hits", decades(-3, 8), direction_grid),
    Family(
        "batch, fine grid",
        "angle of a cell (rad)",
        decades(0, -6),
        narrow_triangle,
        float_is_enough=(1e-2, 1),
        double_error=1e-8,
    ),
    *(
        Family(f"{kind}, size {size:g}", "optical depth", decades(-9, 6), optical_depth(kind, size))
        for kind in ("transmittance", "integral")
        for size in (1e-6, 1.0, 1e6)
    ),
    Family("transmittance, float limits", "sigma_t (1/size)", FLOAT_LIMITS, coefficient_limit("transmittance")),
    Family("integral, float limits", "sigma_t (1/size)", FLOAT_LIMITS, coefficient_limit("integral")),
    Family("segment, near", "distance to the segment / size", decades(-1, -9), segment_near),
    Family("segment, narrow", "angle (rad)", decades(-1, -12), segment_angle),
]
