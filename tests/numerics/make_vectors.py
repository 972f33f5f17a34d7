"""High-precision answers for the closed forms of server/derivatives, in vectors/*.json.

Values come from their definitions in 120-digit arithmetic, derivatives from central differences of those values: none
of the derivative formulas under test is used. Inputs are doubles and taken as exact. The cases with which the files
began are kept and recomputed; stiff ones are added to them.

    python -m tests.numerics.make_vectors            # writes the files
    python -m tests.numerics.make_vectors --check    # fails if a file differs from what would be written
"""

import argparse
import json
import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mpmath import mp, mpf

VECTORS = Path(__file__).parent / "vectors"
GIVEN = "given"
STIFF = "stiff"

Vector = list[mpf]
Case = dict[str, Any]

mp.dps = 120
# Differences of step h have errors h^2 relative to the squared distance over which the field changes: 1e-60 of it.
RELATIVE_STEP = mpf(10) ** -30


def exact(numbers: Sequence[float]) -> Vector:
    return [mpf(number) for number in numbers]


def subtract(a: Vector, b: Vector) -> Vector:
    return [p - q for p, q in zip(a, b, strict=True)]


def dot(a: Vector, b: Vector) -> mpf:
    return mp.fsum(p * q for p, q in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def length(a: Vector) -> mpf:
    return mp.sqrt(dot(a, a))


def triangle_form_factor(point: Vector, vertices: Sequence[Vector]) -> mpf:
    """Signed solid angle / 4 pi (Van Oosterom and Strackee 1983)."""
    r1, r2, r3 = (subtract(vertex, point) for vertex in vertices)
    l1, l2, l3 = length(r1), length(r2), length(r3)
    numerator = dot(r1, cross(subtract(vertices[1], vertices[0]), subtract(vertices[2], vertices[0])))
    denominator = l1 * l2 * l3 + dot(r1, r2) * l3 + dot(r2, r3) * l1 + dot(r3, r1) * l2
    return mp.atan2(numerator, denominator) / (2 * mp.pi)


def segment_form_factor(point: Vector, vertices: Sequence[Vector]) -> mpf:
    """Signed angle / 2 pi."""
    first, second = (mp.mpc(*subtract(vertex, point)) for vertex in vertices)
    return mp.arg(second / first) / (2 * mp.pi)


def transmittance(sigma_t: mpf, point: Vector, vertex: Vector) -> mpf:
    return mp.exp(-sigma_t * length(subtract(vertex, point)))


def transmittance_integral(sigma_t: mpf, point: Vector, vertex: Vector) -> mpf:
    """Integral of the transmittance along the line from the point to the vertex."""
    distance = length(subtract(vertex, point))
    return distance if sigma_t == 0 else -mp.expm1(-sigma_t * distance) / sigma_t


def with_derivatives(field: Callable[[Vector], mpf], point: Vector, scale: mpf) -> dict[str, Any]:
    """Value, gradient and Hessian (upper triangle, row by row) of `field`, which changes over `scale`, as doubles."""
    step = scale * RELATIVE_STEP

    def at(*moves: tuple[int, int]) -> mpf:
        moved = list(point)
        for axis, sign in moves:
            moved[axis] += sign * step
        return field(moved)

    axes = range(len(point))
    value = field(point)
    gradient = [(at((i, 1)) - at((i, -1))) / (2 * step) for i in axes]
    hessian = []
    for i in axes:
        hessian.append((at((i, 1)) - 2 * value + at((i, -1))) / step**2)
        for j in axes[i + 1 :]:
            mixed = at((i, 1), (j, 1)) - at((i, 1), (j, -1)) - at((i, -1), (j, 1)) + at((i, -1), (j, -1))
            hessian.append(mixed / (4 * step**2))
    # What is 0 in exact arithmetic comes out as the rounding of the second differences, with digits to spare.
    noise = mpf(10) ** (80 - mp.dps)

    def rounded(number: mpf, size: mpf) -> float:
        return 0.0 if abs(number) < noise * size else float(number)

    size = max(abs(value), *(abs(g) * scale for g in gradient), *(abs(h) * scale**2 for h in hessian))
    return {
        "value": rounded(value, size),
        "gradient": [rounded(g, size / scale) for g in gradient],
        "hessian": [rounded(h, size / scale**2) for h in hessian],
    }


def distance_to_edges(point: Vector, vertices: Sequence[Vector]) -> mpf:
    """Distance from the point to the nearest edge: what a form factor changes over."""
    distances = []
    for i, start in enumerate(vertices):
        edge = subtract(vertices[(i + 1) % len(vertices)], start)
        to_point = subtract(point, start)
        square = dot(edge, edge)
        along = min(max(dot(to_point, edge) / square, mpf(0)), mpf(1)) if square > 0 else mpf(0)
        distances.append(length(subtract(to_point, [along * e for e in edge])))
    return min(distances)


def triangle_case(case: Case) -> Case:
    point, vertices = exact(case["point"]), [exact(v) for v in case["vertices"]]
    field = with_derivatives(lambda x: triangle_form_factor(x, vertices), point, distance_to_edges(point, vertices))
    return {"tag": case["tag"], "point": case["point"], "vertices": case["vertices"], **field}


def segment_case(case: Case) -> Case:
    point, vertices = exact(case["point"]), [exact(v) for v in case["vertices"]]
    field = with_derivatives(lambda x: segment_form_factor(x, vertices), point, distance_to_edges(point, vertices))
    return {"tag": case["tag"], "point": case["point"], "vertices": case["vertices"], **field}


def transmittance_case(case: Case) -> Case:
    sigma_t, point, vertex = mpf(case["sigma_t"]), exact(case["point"]), exact(case["vertex"])
    distance = length(subtract(vertex, point))
    scale = min(distance, 1 / sigma_t) if sigma_t > 0 else distance
    return {
        "tag": case["tag"],
        "sigma_t": case["sigma_t"],
        "point": case["point"],
        "vertex": case["vertex"],
        "transmittance": with_derivatives(lambda x: transmittance(sigma_t, x, vertex), point, scale),
        "integral": with_derivatives(lambda x: transmittance_integral(sigma_t, x, vertex), point, distance),
    }


def assembly_case(case: Case) -> Case:
    """Radiance of a closed virtual triangulation under the farthest-vertex rule (method.md section 2)."""
    sigma_t, point, vertices = mpf(case["sigma_t"]), exact(case["point"]), [exact(v) for v in case["vertices"]]

    def radiance(x: Vector) -> mpf:
        through = [mpf(L) * transmittance(sigma_t, x, v) for L, v in zip(case["radiance"], vertices, strict=True)]
        return mp.fsum(
            through[far] * triangle_form_factor(x, [vertices[i] for i in corners])
            for corners, far in zip(case["triangles"], case["farthest"], strict=True)
        )

    inputs = {key: case[key] for key in ("tag", "sigma_t", "point", "vertices", "radiance", "triangles", "farthest")}
    nearest = min(length(subtract(vertex, point)) for vertex in vertices)
    return {**inputs, **with_derivatives(radiance, point, nearest)}


def shells_case(case: Case) -> Case:
    """Shells of a medium under the plain rule of method.md section 8.1, with a constant source subtracted (8.3).

    Shell k lies at (k + 1/2) step; a ray's vertex is there, or where the ray ends before it. A triangle's weight is the
    mean of (q - subtracted) T over its rays that haven't ended, and the constant itself counts with the integral of
    transmittance up to the farthest of the triangle's ends.
    """
    point, directions, ends = exact(case["point"]), [exact(d) for d in case["directions"]], exact(case["ends"])
    sigma_t, sigma_s, step, subtracted = (mpf(case[key]) for key in ("sigma_t", "sigma_s", "step", "subtracted"))

    def on_ray(ray: int, distance: mpf) -> Vector:
        return [p + distance * d for p, d in zip(point, directions[ray], strict=True)]

    shells = [(k + mpf(0.5)) * step for k in range(len(case["source"][0]))]
    vertices = [[on_ray(i, min(distance, end)) for i, end in enumerate(ends)] for distance in shells]
    farthest = [max(corners, key=lambda i: ends[i]) for corners in case["triangles"]]
    last = [on_ray(i, end) for i, end in enumerate(ends)]

    def radiance(x: Vector) -> mpf:
        total = mpf(0)
        for corners, far in zip(case["triangles"], farthest, strict=True):
            whole = triangle_form_factor(x, [last[i] for i in corners])
            total += subtracted * transmittance_integral(sigma_t, x, last[far]) * whole
            for k, distance in enumerate(shells):
                alive = [i for i in corners if distance < ends[i]]
                if not alive:
                    continue
                light = mp.fsum(
                    (mpf(case["source"][i][k]) - subtracted) * transmittance(sigma_t, x, vertices[k][i]) for i in alive
                )
                total += step * light / len(alive) * triangle_form_factor(x, [vertices[k][i] for i in corners])
        return sigma_s * total

    inputs = ("tag", "sigma_t", "sigma_s", "step", "point", "directions", "ends", "triangles", "source", "subtracted")
    return {**{key: case[key] for key in inputs}, **with_derivatives(radiance, point, min(shells[0], min(ends)))}


def direction(source: random.Random, dimensions: int) -> list[float]:
    gaussian = [source.gauss(0, 1) for _ in range(dimensions)]
    norm = sum(g * g for g in gaussian) ** 0.5
    return [g / norm for g in gaussian]


def stiff_triangles() -> list[Case]:
    source = random.Random(20)
    cases: list[Case] = []

    def add(name: str, point: Sequence[float], *vertices: Sequence[float]) -> None:
        cases.append({"tag": f"{STIFF}_{name}", "point": list(point), "vertices": [list(v) for v in vertices]})

    def near(center: Sequence[float], size: float) -> list[float]:
        return [c + size * d for c, d in zip(center, direction(source, 3), strict=True)]

    for exponent in (-140, -100, -30, -18, 18, 30, 100, 140):
        # Powers of two keep the shape exact.
        scale = 2.0 ** round(exponent * 3.3219)
        corners = [[scale * c for c in near([0, 0, 2], 1)] for _ in range(3)]
        add("scale", [0, 0, 0], *corners)
    for exponent in (3, 6, 8):
        for _ in range(2):
            offset = [10.0**exponent * d for d in direction(source, 3)]
            add("offset", near(offset, 1), *(near(offset, 1) for _ in range(3)))
    for exponent in (-5, -7, -9, -12):
        gap = 10.0**exponent
        add("near_edge", [0.3, -gap, 0.5 * gap], [0, 0, 0], [1, 0, 0], [0.2, 0.9, 0])
        add("near_vertex", [-gap, -0.4 * gap, 0.2 * gap], [0, 0, 0], [1, 0, 0], [0.2, 0.9, 0])
        add("near_plane", [0.4, 0.3, gap], [0, 0, 0], [1, 0, 0], [0.2, 0.9, 0])
        add("near_plane_outside", [1.4, 0.9, gap], [0, 0, 0], [1, 0, 0], [0.2, 0.9, 0])
        add("short_edge_needle", [0.4, 0.3, 1], [0, 0, 0], [0, gap, 0], [1, 0.1, 0.2])
        add("small_and_far", [0, 0, 0], *([*(3 * gap * d for d in direction(source, 2)), 1 + gap] for _ in range(3)))
    for exponent in (-3, 3, 5, 8):
        far = 10.0**exponent
        # Near blocker before a far light: one and two corners near.
        add("near_before_far", [0, 0, 0], [0.1, 0.02, 1], [0.13 * far, 0.05 * far, far], [0.1 * far, 0.08 * far, far])
        add("near_before_far", [0, 0, 0], [0.1, 0.02, 1], [0.11, 0.05, 1], [0.1 * far, 0.08 * far, far])
    for _ in range(4):
        first, second = direction(source, 3), direction(source, 3)
        add("edge_on", [0, 0, 0], first, second, [2 * a + 3 * b for a, b in zip(first, second, strict=True)])
    corners = [near([0, 0, 1.5], 1) for _ in range(3)]
    add("inverted", [0, 0, 0], corners[0], corners[1], corners[2])
    add("inverted", [0, 0, 0], corners[1], corners[0], corners[2])
    return cases


def stiff_segments() -> list[Case]:
    cases: list[Case] = []
    for exponent in (-5, -7, -9, -12):
        gap = 10.0**exponent
        cases.append({"tag": f"{STIFF}_near_line", "point": [0.3, gap], "vertices": [[0.0, 0.0], [1.0, 0.0]]})
        cases.append({"tag": f"{STIFF}_near_end", "point": [-gap, gap], "vertices": [[0.0, 0.0], [1.0, 0.0]]})
        cases.append({"tag": f"{STIFF}_far", "point": [0.0, 0.0], "vertices": [[1.0, 0.2 * gap], [1.0, 1.2 * gap]]})
    for exponent in (3, 8):
        far = 10.0**exponent
        cases.append({"tag": f"{STIFF}_near_before_far", "point": [0.0, 0.0], "vertices": [[0.1, 1.0], [0.0, far]]})
    for exponent in (-140, 140):
        scale = 2.0 ** round(exponent * 3.3219)
        vertices = [[scale, 0.5 * scale], [0.25 * scale, 2 * scale]]
        cases.append({"tag": f"{STIFF}_scale", "point": [0.0, 0.0], "vertices": vertices})
    return cases


def stiff_transmittances() -> list[Case]:
    source = random.Random(21)
    cases: list[Case] = []
    for exponent in range(-9, 7):
        for size in (1e-6, 1.0, 1e6):
            vertex = [size * d for d in direction(source, 3)]
            sigma_t = 10.0**exponent / size
            cases.append({"tag": STIFF, "sigma_t": sigma_t, "point": [0.0, 0.0, 0.0], "vertex": vertex})
    return cases


FILES: dict[str, tuple[Callable[[Case], Case], Callable[[], list[Case]]]] = {
    "triangle3d": (triangle_case, stiff_triangles),
    "segment2d": (segment_case, stiff_segments),
    "transmittance3d": (transmittance_case, stiff_transmittances),
    "assembly3d": (assembly_case, list),
    "shells3d": (shells_case, list),
}


def contents(name: str) -> str:
    compute, stiff = FILES[name]
    given = json.loads((VECTORS / f"{name}.json").read_text())["cases"]
    inputs = [case for case in given if not case["tag"].startswith(STIFF)] + stiff()
    lines = ",\n".join(json.dumps(compute(case)) for case in inputs)
    return f'{{"cases": [\n{lines}\n]}}\n'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    check = parser.parse_args().check
    differing = []
    for name in FILES:
        path = VECTORS / f"{name}.json"
        text = contents(name)
        if not check:
            path.write_text(text)
        elif path.read_text() != text:
            differing.append(path.name)
    if differing:
        print("differs from what make_vectors.py computes: " + ", ".join(differing), file=sys.stderr)
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
