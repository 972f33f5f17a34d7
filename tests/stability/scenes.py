"""Scene-level stiff cases through the occlusion-aware estimator, held against closed forms or invariance."""

import itertools
import json
import math
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mpmath import mpf

from tests.bench.engines import BINARIES, ROOT
from tests.numerics import make_vectors as exact
from tests.stability.cases import Json, Point, decades, scaled
from tests.stability.measure import QUANTITIES, Row, numbers, relative_error

# Of the scattering medium where nothing is to be lost in it.
CLEAR = 1e-12


def medium(sigma_t: str, albedo: float, center: Point, half_size: float) -> str:
    x, y, z = center
    return f"""
    <medium type="homogeneous" id="fog">
      <rgb name="sigma_t" value="{sigma_t}"/> <float name="albedo" value="{albedo}"/> <phase type="isotropic"/>
    </medium>
    <shape type="cube">
      <transform name="to_world"> <scale value="{half_size!r}"/> <translate x="{x!r}" y="{y!r}" z="{z!r}"/> </transform>
      <bsdf type="null"/> <ref name="interior" id="fog"/>
    </shape>"""


def rectangle(center: Point, half_width: float, half_height: float, inside: str, faces_down: bool = False) -> str:
    x, y, z = center
    turn = '<rotate x="1" angle="180"/>' if faces_down else ""
    return f"""
    <shape type="rectangle">
      <transform name="to_world"> {turn} <scale x="{half_width!r}" y="{half_height!r}" z="{half_height!r}"/>
        <translate x="{x!r}" y="{y!r}" z="{z!r}"/> </transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf> {inside}
    </shape>"""


EMITTER = '<emitter type="area"><rgb name="radiance" value="1"/></emitter>'


@dataclass(frozen=True)
class Comparison:
    """An answer and what it should be: (value, gradient, Hessian)."""

    found: Json
    expected: Json


@dataclass(frozen=True)
class SceneFamily:
    """Comparisons at each parameter; `allowed` are the largest errors of value, gradient and Hessian.

    Errors are relative, and absolute where nothing is expected.
    """

    name: str
    parameter: str
    parameters: list[float]
    compare: Callable[[float], list[Comparison]]
    allowed: tuple[float, float, float]
    note: str


def estimate(scene: str, points: Sequence[Point], **settings: str | int) -> list[list[Json]]:
    """Channels of the radiance at points."""
    case = {"scene": scene, "points": points, "order": "single", "samples": 1024, "max_depth": 2, **settings}
    completed = subprocess.run(
        [str(BINARIES / "stability_estimate")],
        input=json.dumps([case]),
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        check=True,
    )
    answers: list[list[Json]] = json.loads(completed.stdout)[0]
    return answers


def polygon_form_factor(point: exact.Vector, corners: Sequence[exact.Vector]) -> mpf:
    fan = itertools.pairwise(corners[1:])
    return sum((exact.triangle_form_factor(point, [corners[0], b, c]) for b, c in fan), mpf(0))


def positive(field: Json) -> Json:
    """The same whichever way the polygon turns."""
    sign = math.copysign(1.0, field["value"])
    return {name: [sign * n for n in x] if isinstance(x, list) else sign * x for name, x in field.items()}


def upward_corners(center: Point, half: float) -> list[exact.Vector]:
    """Of a square in a plane z = const, counter-clockwise for those above it."""
    x, y, z = (mpf(c) for c in center)
    h = mpf(half)
    return [[x - h, y - h, z], [x - h, y + h, z], [x + h, y + h, z], [x + h, y - h, z]]


def unblocked(center: Point, half: float, points: list[Point]) -> list[Comparison]:
    """A square light that faces up and nothing else: radiance 1 times its form factor."""
    corners = upward_corners(center, half)
    reach = 4 * max(half, *(math.dist(center, point) for point in points))
    found = estimate(rectangle(center, half, half, EMITTER) + medium(str(CLEAR / reach), 0.5, center, reach), points)
    result = []
    for point, channels in zip(points, found, strict=True):
        x = exact.exact(point)
        truth = exact.with_derivatives(
            lambda y: polygon_form_factor(y, corners), x, exact.distance_to_edges(x, corners)
        )
        result.append(Comparison(channels[0], positive(truth)))
    return result


def above_light(distance: float) -> list[Comparison]:
    return unblocked([0.0, 0.0, 0.0], 0.5, [[0.1, 0.2, distance], [-0.3, 0.15, distance]])


def beside_light(elevation: float) -> list[Comparison]:
    return unblocked([0.0, 0.0, 0.0], 0.5, [[1.5, 0.25, elevation], [1.0, -1.25, elevation]])


def small_light(size: float) -> list[Comparison]:
    return unblocked([0.0, 0.0, 0.0], size, [[0.25, 0.5, 1.0], [-0.125, 0.25, 2.0]])


def penumbra(scale: float, offset: Point, sigma_t: str) -> str:
    """A square light over a plate that hides half of it; all coordinates are multiples of 1/8 before scaling."""

    def at(x: float, y: float, z: float) -> Point:
        return [scale * c + o for c, o in zip((x, y, z), offset, strict=True)]

    return (
        rectangle(at(0, 0, 2), scale, scale, EMITTER, faces_down=True)
        + rectangle(at(-2, 0, 1), 2 * scale, 4 * scale, "")
        + medium(sigma_t, 0.5, at(0, 0, 0), 8 * scale)
    )


PENUMBRA_POINTS: list[Point] = [[0.125, 0.25, 0.0], [-0.25, 0.5, 0.0], [0.375, -0.25, 0.25]]


def rescaled(field: Json, scale: float) -> Json:
    """Derivatives of a field whose lengths were multiplied by `scale`, in the old lengths."""
    gradient = [scale * g for g in field["gradient"]]
    return {"value": field["value"], "gradient": gradient, "hessian": [scale**2 * h for h in field["hessian"]]}


def scaled_scene(scale: float) -> list[Comparison]:
    # Powers of two: the scene is the same to the bit.
    factor = 2.0 ** round(math.log2(scale))
    points = [scaled(point, factor) for point in PENUMBRA_POINTS]
    found = estimate(penumbra(factor, [0.0, 0.0, 0.0], repr(0.5 / factor)), points)
    expected = estimate(penumbra(1.0, [0.0, 0.0, 0.0], "0.5"), PENUMBRA_POINTS)
    pairs = zip(found, expected, strict=True)
    return [Comparison(rescaled(f[0], factor), e[0]) for f, e in pairs]


def moved_scene(distance: float) -> list[Comparison]:
    # A multiple of 1/8 that float holds exactly up to 2^20.
    offset = [float(round(distance)), 0.0, float(-round(distance / 2))]
    points = [[p + o for p, o in zip(point, offset, strict=True)] for point in PENUMBRA_POINTS]
    found = estimate(penumbra(1.0, offset, "0.5"), points)
    expected = estimate(penumbra(1.0, [0.0, 0.0, 0.0], "0.5"), PENUMBRA_POINTS)
    return [Comparison(f[0], e[0]) for f, e in zip(found, expected, strict=True)]


def chromatic(ratio: float) -> list[Comparison]:
    """Each channel of a chromatic medium is a grey medium's."""
    extinctions = [1.0 / ratio, 1.0 / math.sqrt(ratio), 1.0]
    found = estimate(penumbra(1.0, [0.0] * 3, ", ".join(map(repr, extinctions))), PENUMBRA_POINTS)
    result = []
    for channel, sigma_t in enumerate(extinctions):
        grey = estimate(penumbra(1.0, [0.0] * 3, repr(sigma_t)), PENUMBRA_POINTS)
        result += [Comparison(f[channel], e[channel]) for f, e in zip(found, grey, strict=True)]
    return result


def visible_corners(point: exact.Vector, far: mpf, edge_x: mpf, edge_z: mpf) -> list[exact.Vector]:
    """The square light |x|, |y| <= far/4 at z = far, facing down, right of the line of sight past an edge along y."""
    half = far / 4
    bound = point[0] + (edge_x - point[0]) * (far - point[2]) / (edge_z - point[2])
    left = min(max(bound, -half), half)
    return [[left, -half, far], [half, -half, far], [half, half, far], [left, half, far]]


def far_light(ratio: float) -> list[Comparison]:
    """Penumbra of a blocker at distance 1 before a light `ratio` times as far and as large."""
    far = 2.0 ** round(math.log2(max(ratio, 2.0)))
    points: list[Point] = [[0.03125, 0.0625, 0.0], [-0.0625, -0.03125, 0.125]]
    scene = (
        rectangle([0.0, 0.0, far], far / 4, far / 4, EMITTER, faces_down=True)
        + rectangle([-2.0, 0.0, 1.0], 2.0, 4.0, "")
        + medium(str(CLEAR / far), 0.5, [0.0, 0.0, 0.0], 2 * far)
    )
    result = []
    for point, channels in zip(points, estimate(scene, points), strict=True):

        def radiance(x: exact.Vector) -> mpf:
            return polygon_form_factor(x, visible_corners(x, mpf(far), mpf(0), mpf(1)))

        truth = exact.with_derivatives(radiance, exact.exact(point), mpf(1))
        result.append(Comparison(channels[0], positive(truth)))
    return result


def quadrature(point: Point, half: float, sigma_t: float) -> Json:
    """Radiance of the square |x|, |y| <= half at z = 0 through a medium, with the kernel T cos / l^2 differentiated."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    x, y = (half * grid - p for grid, p in zip(np.meshgrid(nodes, nodes), point, strict=False))
    r = np.stack([x, y, np.full_like(x, -point[2])], axis=-1)
    length = np.linalg.norm(r, axis=-1)
    u = r / length[..., None]
    normal = np.array([0.0, 0.0, -1.0])
    facing = r @ normal
    kernel = half**2 * np.outer(weights, weights) * np.exp(-sigma_t * length) * facing / length**3 / (4 * math.pi)
    # Gradient and Hessian of the kernel's logarithm: -sigma_t l - 3 log l + log(n . r), with r = vertex - point.
    slope = (sigma_t + 3 / length)[..., None] * u - normal / facing[..., None]
    outer = u[..., :, None] * u[..., None, :]
    identity = np.eye(3)
    curvature = (
        -(sigma_t / length)[..., None, None] * (identity - outer)
        - (3 / length**2)[..., None, None] * (identity - 2 * outer)
        - normal[:, None] * normal[None, :] / (facing**2)[..., None, None]
    )
    hessian = np.einsum("ij,ijab->ab", kernel, curvature + slope[..., :, None] * slope[..., None, :])
    return {
        "value": float(kernel.sum()),
        "gradient": np.einsum("ij,ija->a", kernel, slope).tolist(),
        "hessian": hessian[np.triu_indices(3)].tolist(),
    }


def thick(sigma_t: float) -> list[Comparison]:
    points: list[Point] = [[0.1, 0.2, 1.0], [-0.3, 0.15, 0.75]]
    scene = rectangle([0.0] * 3, 0.5, 0.5, EMITTER) + medium(repr(sigma_t), 0.5, [0.0] * 3, 4)
    # Beyond double's range both are 0.
    truths = [quadrature([float(np.float32(c)) for c in point], 0.5, float(np.float32(sigma_t))) for point in points]
    return [Comparison(f[0], truth) for f, truth in zip(estimate(scene, points), truths, strict=True)]


def white_furnace(absorption: float) -> list[Comparison]:
    """Inside walls of radiance 1 and a medium that absorbs `absorption` of what it meets, radiance tends to 1.

    A medium that scatters nothing sends nothing to any camera: its radiance isn't asked for and comes out as 0.
    """
    turns = ["", *(f'<rotate {axis}="1" angle="{angle}"/>' for axis, angle in (("x", 90), ("x", 180), ("x", 270)))]
    turns += [f'<rotate y="1" angle="{angle}"/>' for angle in (90, 270)]
    walls = "".join(
        f"""
    <shape type="rectangle"> <transform name="to_world"> <translate z="-1"/> {turn} </transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf> {EMITTER}
    </shape>"""
        for turn in turns
    )
    scene = walls + medium("1", 1 - absorption, [0.0] * 3, 0.999)
    found = estimate(scene, [[0.1, 0.2, 0.3]], order="both", samples=1024, max_depth=-1)
    expected: Json = {"value": 0.0 if absorption == 1 else 1.0, "gradient": [0.0] * 3, "hessian": [0.0] * 6}
    return [Comparison(found[0][0], expected)]


def measure_scenes(families: Sequence[SceneFamily]) -> list[Row]:
    """One row a family and parameter: the worst of its comparisons."""
    rows = []
    for family in families:
        for parameter in family.parameters:
            comparisons = family.compare(parameter)
            errors = [
                max(relative_error(numbers(c.found[q]), numbers(c.expected[q]), 0.0) for c in comparisons)
                for q in QUANTITIES
            ]
            is_finite = all(n is not None for c in comparisons for q in QUANTITIES for n in numbers(c.found[q]))
            wrong_sign = is_finite and any(
                c.found["value"] * c.expected["value"] < 0
                or math.fsum(f * e for f, e in zip(c.found["gradient"], c.expected["gradient"], strict=True)) < 0
                for c in comparisons
            )
            value, gradient, hessian = errors
            rows.append(Row(family.name, parameter, "double", (value, gradient, hessian), (), is_finite, wrong_sign))
    return rows


def is_as_allowed(family: SceneFamily, row: Row) -> bool:
    within = all(error <= allowed for error, allowed in zip(row.errors, family.allowed, strict=True))
    return row.is_finite and not row.is_wrong_sign and within


SCENE_FAMILIES = [
    SceneFamily(
        "scaled scene",
        "scale",
        decades(-6, 6),
        scaled_scene,
        (5e-3, 1e-2, 0.16),
        "against scale 1, sigma_t scaled too; the grid's jitter hangs on the point and differs",
    ),
    SceneFamily(
        "moved scene",
        "distance / size",
        decades(0, 6),
        moved_scene,
        (5e-3, 1e-2, 0.16),
        "against the scene at the origin; the jitter differs",
    ),
    SceneFamily(
        "near the light", "distance / size", decades(-1, -7), above_light, (1e-5, 1e-5, 1e-4), "against the closed form"
    ),
    SceneFamily(
        "light at the horizon",
        "elevation / size",
        decades(-1, -7),
        beside_light,
        (1e-4, 1e-4, 1e-4),
        "against the closed form; the light's plane all but holds the point",
    ),
    SceneFamily(
        "small light",
        "half width / distance",
        decades(-1, -6),
        small_light,
        (1e-5, 1e-5, 1e-5),
        "against the closed form; 4e-12 sr at the end",
    ),
    SceneFamily(
        "far light",
        "distance of light / blocker",
        [2.0, *decades(1, 8)],
        far_light,
        (2e-2, 2e-2, 0.16),
        "against the closed form of what an endless edge leaves visible",
    ),
    SceneFamily(
        "thick medium",
        "sigma_t (1/size)",
        decades(-9, 6),
        thick,
        (2e-2, 5e-2, 0.16),
        "against quadrature; cells of the light grid are thick from 10 on",
    ),
    SceneFamily(
        "chromatic medium",
        "ratio of extinctions",
        decades(0, 4),
        chromatic,
        (1e-6, 1e-6, 1e-6),
        "against grey media, channel by channel",
    ),
    SceneFamily(
        "white furnace",
        "1 - albedo",
        [1e-6, 1e-3, 1.0],
        white_furnace,
        (5e-2, 0.5, 5.0),
        "value near 1; derivatives, which are noise, against value / size",
    ),
]
