"""High-precision cosine-weighted form factors of triangles for server/derivatives/irradiance_edge.h.

Values are those of Lambert's closed form at 80 digits, held against the area integral of n.u n'.u / (pi r^2) by
quadrature wherever that converges; gradient and Hessian are its differences, over steps so small that they are exact in
double precision. None of the derivatives under test enters.

    python -m tests.numerics.make_irradiance            # writes the file
    python -m tests.numerics.make_irradiance --check    # fails if it differs from what would be written
"""

import argparse
import json
import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpmath import matrix, mp, mpf

FILE = Path(__file__).parent / "vectors" / "irradiance3d.json"
mp.dps = 80
STEP = mpf(10) ** -16

Vector = list[float]


def cross(a: matrix, b: matrix) -> matrix:
    return matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def dot(a: matrix, b: matrix) -> mpf:
    return mp.fsum(a[i] * b[i] for i in range(3))


def quadrature(vertices: list[matrix], normal: matrix) -> mpf:
    """Area integral, signed by the winding; u and v are barycentric (1 - u, u (1 - v), u v)."""
    edge1, edge2 = vertices[1] - vertices[0], vertices[2] - vertices[0]
    area = cross(edge1, edge2)

    def kernel(u: mpf, v: mpf) -> mpf:
        r = vertices[0] + u * (edge1 + v * (edge2 - edge1))
        return u * dot(normal, r) * dot(area, r) / (mp.pi * dot(r, r) ** 2)

    return mp.quad(kernel, [0, 1], [0, 1])


def lambert(vertices: list[matrix], normal: matrix) -> mpf:
    total = mpf(0)
    for a, b in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        c = cross(a, b)
        size = mp.sqrt(dot(c, c))
        if size > 0:
            total += mp.atan2(size, dot(a, b)) * dot(normal, c) / size
    return total / (2 * mp.pi)


def derivatives(value: Callable[[matrix], mpf]) -> tuple[list[float], list[float]]:
    """Central differences in space; their error is of the order of the squared step."""
    axis = [matrix([STEP if i == k else 0 for k in range(3)]) for i in range(3)]
    zero = matrix([0, 0, 0])
    gradient = [(value(axis[i]) - value(-axis[i])) / (2 * STEP) for i in range(3)]
    hessian = []
    for i in range(3):
        for j in range(i, 3):
            if i == j:
                second = value(axis[i]) - 2 * value(zero) + value(-axis[i])
            else:
                same = value(axis[i] + axis[j]) + value(-axis[i] - axis[j])
                opposite = value(axis[i] - axis[j]) + value(axis[j] - axis[i])
                second = (same - opposite) / 4
            hessian.append(second / STEP**2)
    return [float(g) for g in gradient], [float(h) for h in hessian]


def case(tag: str, normal: Vector, triangle: list[Vector], *, compare: bool = True) -> dict[str, Any]:
    """`triangle` relative to the point."""
    vertices = [matrix([mpf(x) for x in vertex]) for vertex in triangle]
    n = matrix([mpf(x) for x in normal])

    def at(offset: matrix) -> mpf:
        return lambert([vertex - offset for vertex in vertices], n)

    value = at(matrix([0, 0, 0]))
    if compare:
        with mp.workdps(18):
            integral = quadrature(vertices, n)
            if abs(integral - value) > mpf(10) ** -12 * abs(value):
                raise ArithmeticError(f"{tag}: Lambert's formula says {value}, quadrature {integral}")
    gradient, hessian = derivatives(at)
    return {
        "tag": tag,
        "normal": normal,
        "vertices": triangle,
        "value": float(value),
        "gradient": gradient,
        "hessian": hessian,
    }


def cases() -> list[dict[str, Any]]:
    source = random.Random(7)
    result = []
    up: Vector = [0.0, 0.0, 1.0]
    for _ in range(8):
        triangle = [[source.uniform(-2, 2), source.uniform(-2, 2), source.uniform(0.2, 3)] for _ in range(3)]
        result.append(case("random", up, triangle))
    for _ in range(4):
        normal = [source.gauss(0, 1) for _ in range(3)]
        length = sum(x * x for x in normal) ** 0.5
        normal = [x / length for x in normal]
        # All of it in front of the surface.
        triangle = [[2 * n + source.uniform(-0.45, 0.45) for n in normal] for _ in range(3)]
        result.append(case("turned", normal, triangle))
    # Vertices on the horizon, as a hemisphere's grid has.
    result.append(case("horizon", up, [[1.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.25, 0.25, 1.0]], compare=False))
    # Triangles between a near surface and a far one.
    slanted = [
        [[0.01, 0.003, 0.02], [0.012, -0.004, 0.021], [40.0, 10.0, 60.0]],
        [[0.01, 0.0, 0.02], [30.0, 15.0, 60.0], [40.0, 10.0, 60.0]],
    ]
    result += [case("slanted", up, triangle, compare=False) for triangle in slanted]
    # Small as seen from the point: the terms of the edges all but cancel.
    for size in (1e-2, 1e-4):
        result.append(case("far", up, [[1.0, 2.0, 3.0], [1.0 + size, 2.0, 3.0], [1.0, 2.0 + size, 3.0 + size]]))
    # Edges of wide angles, up to 170 degrees.
    result.append(case("wide", up, [[-1.0, 0.0, 0.1], [1.0, 0.1, 0.1], [0.0, 2.0, 1.0]], compare=False))
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with the file instead of writing it")
    arguments = parser.parse_args()
    lines = ",\n".join(json.dumps(entry) for entry in cases())
    text = f'{{"cases": [\n{lines}\n]}}\n'
    if arguments.check:
        return 0 if FILE.read_text() == text else 1
    FILE.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
