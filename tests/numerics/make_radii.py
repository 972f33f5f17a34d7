"""High-precision extents of cache records for server/cache/metric.h, in vectors/radii.json.

The error bound sum |lambda_i| u_i^2 / 2 is integrated over ellipsoids from its definition, by quadrature over radius
and angles, and the level set that meets a budget is found by bisection: neither the closed-form integral nor the root
finding under test is used. The cases with which the file began are kept and recomputed; capped ones are added.

    python -m tests.numerics.make_radii            # writes the file
    python -m tests.numerics.make_radii --check    # fails if it differs from what would be written
"""

import argparse
import json
import random
import sys
from pathlib import Path
from typing import Any

from mpmath import mp, mpf

FILE = Path(__file__).parent / "vectors" / "radii.json"
mp.dps = 40


def second_moment(dim: int) -> mpf:
    """Integral of u_1^2 over the unit ball."""
    if dim == 2:
        return mp.quad(lambda r: r**3, [0, 1]) * mp.quad(lambda t: mp.cos(t) ** 2, [0, 2 * mp.pi])
    return mp.quad(lambda r: r**4, [0, 1]) * mp.quad(lambda z: z**2, [-1, 1]) * 2 * mp.pi


MOMENTS = {dim: second_moment(dim) for dim in (2, 3)}


def integral(curvatures: list[mpf], semi_axes: list[mpf]) -> mpf:
    """Of the bound over the ellipsoid: the unit ball stretched along each axis."""
    terms = mp.fsum(c * a**2 for c, a in zip(curvatures, semi_axes, strict=True))
    return mp.fprod(semi_axes) * MOMENTS[len(curvatures)] * terms / 2


def semi_axes_at(curvatures: list[mpf], caps: list[mpf], level: mpf) -> list[mpf]:
    return [min(mp.sqrt(level / c), cap) for c, cap in zip(curvatures, caps, strict=True)]


def level_set(eigenvalues: list[float], budget: float, caps: list[mpf], anisotropy: mpf) -> list[mpf]:
    """Semi-axes min(sqrt(k / |lambda_i|), caps_i) whose integral is the budget, or the caps."""
    sizes = [abs(mpf(value)) for value in eigenvalues]
    curvatures = [max(size, max(sizes) / anisotropy**2) for size in sizes]
    if integral(curvatures, caps) <= budget:
        return caps
    low, high = mpf(-400), mpf(400)
    for _ in range(150):
        middle = (low + high) / 2
        if integral(curvatures, semi_axes_at(curvatures, caps, mp.exp(middle))) < budget:
            low = middle
        else:
            high = middle
    return semi_axes_at(curvatures, caps, mp.exp(low))


def ball(eigenvalues: list[float], budget: float) -> mpf:
    curvatures = [abs(mpf(value)) for value in eigenvalues]
    unit = integral(curvatures, [mpf(1)] * len(curvatures))
    return mp.root(mpf(budget) / unit, len(curvatures) + 2)


def case(tag: str, eigenvalues: list[float], budget: float, caps: list[float], anisotropy: float) -> dict[str, Any]:
    """Caps of 0 stand for none."""
    limits = [mpf(cap) if cap > 0 else mp.mpf("1e100") for cap in caps]
    axes = level_set(eigenvalues, budget, limits, mpf(anisotropy))
    return {
        "tag": tag,
        "eigenvalues": eigenvalues,
        "budget": budget,
        "caps": caps,
        "maximum_anisotropy": anisotropy,
        "semi_axes": [float(axis) for axis in axes],
        "ball_radius": float(ball(eigenvalues, budget)),
    }


def cases() -> list[dict[str, Any]]:
    given = [entry for entry in json.loads(FILE.read_text())["cases"] if entry["tag"] == "given"]
    result = [case("given", entry["eigenvalues"], entry["budget"], entry["caps"], 1e4) for entry in given]
    generator = random.Random(4)
    for _ in range(24):
        dim = generator.choice((2, 3))
        scale = 10 ** generator.uniform(-6, 6)
        eigenvalues = [generator.choice((-1, 1)) * scale * 10 ** generator.uniform(-4, 0) for _ in range(dim)]
        budget = 10 ** generator.uniform(-6, 2)
        typical = float(ball(eigenvalues, budget))
        caps = [typical * 10 ** generator.uniform(-1, 1) for _ in range(dim)]
        result.append(case("capped", eigenvalues, budget, caps, generator.choice((1.0, 3.0, 10.0, 1e4))))
    result.append(case("flat", [5.0, 0.0, 0.0], 1e-3, [0.0, 2.0, 3.0], 10.0))
    result.append(case("flat", [0.0, -3.0], 1e-3, [0.0, 0.0], 5.0))
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    check = parser.parse_args().check
    text = '{"cases": [\n' + ",\n".join(json.dumps(entry) for entry in cases()) + "\n]}\n"
    if not check:
        FILE.write_text(text)
    elif FILE.read_text() != text:
        print(f"{FILE.name} differs from what make_radii.py computes", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
