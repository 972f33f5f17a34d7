"""Pictures of extreme scenes by the radiance cache, held against path tracing of the same scene or a known solution.

Both are rendered at 24 x 24 pixels in a process of their own, which gives its peak memory. What is compared is the mean
luminance of each quarter of the picture: path tracing's with the standard error of repeated seeds, the cache's with the
error that it was asked for.
"""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from fogbank.comparison import image_error
from matplotlib.figure import Figure

from tests.bench import engines
from tests.stability import dense_ball

SIDE = 24
ERROR = 0.05
"""Asked for where the case doesn't say otherwise."""
STANDARD_ERRORS = 5.0
"""Of path tracing: 4 quarters of 20 pictures leave one in 20,000 of runs beyond."""
PATH_SAMPLES = 64
PATH_SEEDS = 8
PATH_SECONDS = 4.0
"""After which a seed ends, with fewer samples: paths in dense fog are long."""
MOST_SECONDS = 120.0
"""Of CPU time."""
MOST_BYTES = 1 << 30


Luminances: TypeAlias = npt.NDArray[np.float64]


SKY = '<emitter type="constant"><rgb name="radiance" value="1"/></emitter>'


@dataclass(frozen=True)
class PictureCase:
    """An extreme scene, or extreme settings of a plain one."""

    name: str
    scene: Callable[[Path], str]
    """Its text; further files go into the folder."""
    max_depth: int = 16
    settings: dict[str, Any] = field(default_factory=dict)
    black: bool = False
    """Nothing is to be seen."""
    noisy: bool = False
    """The settings forbid a good picture: only that it is finite and ends is checked."""
    shortfall: float = 0.0
    """A difference beyond what is allowed, of black pictures a mean, that is known, yet to be mended: extents are 1.5
    pixels at least, which layers at boundaries are thinner than; far lamps make the greatest extent large; depth bins
    leak a little. More of it is wrong."""
    known: Callable[[], Luminances] | None = None
    """The picture without noise, in place of path tracing."""


@dataclass(frozen=True)
class PictureRow:
    """What a case gave."""

    name: str
    cpu_seconds: float
    peak_bytes: int
    records: int
    path_mean: float
    cache_mean: float
    worst_difference: float
    """Of the quarters, relative to the picture's mean."""
    allowed: float
    verdict: str
    """Empty if all is well."""
    images: tuple[Luminances, Luminances] = field(repr=False)
    """Path tracing's mean and the cache's."""


def fog(sigma_t: float, albedo: float, half: float = 1.5) -> str:
    """A cube of fog."""
    return f"""
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="{sigma_t!r}"/><rgb name="albedo" value="{albedo!r}"/><phase type="isotropic"/>
  </medium>
  <shape type="cube"><transform name="to_world"><scale value="{half!r}"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>"""


def scene(body: str, origin: str = "0, -4, 0", target: str = "0, 0, 0", *, inside: bool = False) -> str:
    """A whole file around shapes and media. Lamps are not seen: a few pixels of them would outweigh all others."""
    hidden = "false" if SKY in body else "true"
    medium = '<ref name="medium" id="fog"/>' if inside else ""
    return f"""<scene version="3.0.0">
  <integrator type="volpath"><boolean name="hide_emitters" value="{hidden}"/></integrator>
  {body}
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="{origin}" target="{target}" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="{SIDE}"/><integer name="height" value="{SIDE}"/></film>
    {medium}
  </sensor>
</scene>"""


def light(half: float = 0.3, radiance: float = 10.0, z: float = 1.2) -> str:
    """A square that faces down."""
    return f"""
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="{half!r}"/>
    <translate z="{z!r}"/></transform><emitter type="area"><rgb name="radiance" value="{radiance!r}"/></emitter>
  </shape>"""


def plate(half: float = 0.5, z: float = 0.0, x: float = -0.4) -> str:
    """A grey square that lies."""
    return f"""
  <shape type="rectangle">
    <transform name="to_world"><scale value="{half!r}"/><translate x="{x!r}" z="{z!r}"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></shape>"""


def box(reflectance: float = 0.3) -> str:
    """Walls, seen from inside."""
    return f"""
  <shape type="cube"><transform name="to_world"><scale value="1.4"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse">
      <rgb name="reflectance" value="{reflectance!r}"/></bsdf></bsdf></shape>"""


def ball_of_stone(center: str) -> str:
    """A small one, closed and grey."""
    return f"""
  <shape type="sphere"><float name="radius" value="0.2"/><transform name="to_world"><translate value="{center}"/>
    </transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"""


def many_triangles(folder: Path) -> str:
    """A million of them: a plate as a height field."""
    side = 708
    u = np.linspace(-1, 1, side)
    x, y = np.meshgrid(u, u)
    z = 0.05 * np.sin(20 * x) * np.cos(17 * y) - 0.8
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype("<f4")
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)[None, :]).ravel()
    lower = np.stack([corner, corner + 1, corner + side + 1], axis=1)
    upper = np.stack([corner, corner + side + 1, corner + side], axis=1)
    faces = np.empty(2 * corner.size, dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"] = 3
    faces["vertices"] = np.concatenate([lower, upper])
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (folder / "field.ply").write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
    field_shape = """
  <shape type="ply"><string name="filename" value="field.ply"/>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></shape>"""
    return scene(fog(0.5, 0.8) + light() + field_shape)


def sun_through_hole(_: Path) -> str:
    """0.27 degrees across, through a hole of 1 cm in a lid of 3 m."""
    lid = "".join(
        f"""
  <shape type="rectangle"><transform name="to_world"><scale x="{sx!r}" y="{sy!r}"/>
    <translate x="{x!r}" y="{y!r}" z="1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></shape>"""
        for sx, sy, x, y in (
            (0.7475, 1.5, -0.7525, 0.0),
            (0.7475, 1.5, 0.7525, 0.0),
            (0.005, 0.7475, 0.0, -0.7525),
            (0.005, 0.7475, 0.0, 0.7525),
        )
    )
    # Radius of a disk at a distance of 100 that is seen under 0.27 degrees.
    sun = """
  <shape type="disk"><transform name="to_world"><rotate x="1" angle="180"/><scale value="0.2356"/>
    <translate z="101"/></transform><emitter type="area"><rgb name="radiance" value="4e5"/></emitter></shape>"""
    return scene(fog(0.5, 0.8) + lid + sun)


def plain_from(origin: str, *, inside: bool = False) -> Callable[[Path], str]:
    """A light over a plate, from somewhere."""
    return lambda _: scene(fog(0.5, 0.8) + light() + plate(), origin, inside=inside)


def ball_under_sky(sigma_t: float, albedo: float) -> Callable[[Path], str]:
    """A ball of fog of radius 1.5 where all else is white."""
    return lambda _: scene(f"""
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="{sigma_t!r}"/><rgb name="albedo" value="{albedo!r}"/><phase type="isotropic"/>
  </medium>
  <shape type="sphere"><float name="radius" value="1.5"/><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  {SKY}""")


PLAIN = [
    PictureCase(
        "white sky, albedo 0.9999, optical depth 100",
        ball_under_sky(33.3, 0.9999),
        max_depth=-1,
        settings={"error": 0.02},
        known=lambda: dense_ball.picture(4.0, 50.0, SIDE, 1.5, 33.3, 0.9999),
        shortfall=0.12,
    ),
    PictureCase(
        "white sky, albedo 1, optical depth 6",
        ball_under_sky(2.0, 1.0),
        max_depth=-1,
        settings={"error": 0.02},
        known=lambda: np.ones((SIDE, SIDE)),
        shortfall=0.07,
    ),
    PictureCase("optical depth 1e-4", lambda _: scene(fog(3.3e-5, 0.8) + light(radiance=1e7) + plate()), shortfall=0.2),
    PictureCase(
        "optical depth 1e4", lambda _: scene(fog(3.3e3, 0.8) + SKY + plate(z=-1.45)), max_depth=64, shortfall=0.13
    ),
    PictureCase(
        "penumbra 1000 times narrower than the room",
        lambda _: scene(fog(0.5, 0.8) + light(half=0.003, radiance=1e5) + plate(z=0.0)),
    ),
    # Its samples are so rare that few of them look like none: a number of them is asked for instead of an error.
    PictureCase("sun of 0.27 degrees through a hole of 1 cm", sun_through_hole, settings={"error": 0.0}, shortfall=0.6),
    PictureCase(
        "light inside dense fog",
        lambda _: scene(
            fog(5.0, 0.95) + '<shape type="sphere"><float name="radius" value="0.1"/>'
            '<emitter type="area"><rgb name="radiance" value="100"/></emitter></shape>'
        ),
        max_depth=64,
    ),
    PictureCase(
        "camera inside an object",
        lambda _: scene(fog(0.5, 0.8) + light() + ball_of_stone("0, -1, 0"), origin="0, -1, 0"),
        black=True,
    ),
    PictureCase("camera inside the medium", plain_from("0, -1, 0", inside=True), shortfall=0.12),
    PictureCase("camera outside the medium", plain_from("0, -4, 0")),
    PictureCase("camera on the boundary", plain_from("0, -1.5, 0", inside=True)),
    PictureCase("empty scene", lambda _: scene(""), black=True),
    PictureCase("medium without light", lambda _: scene(fog(0.5, 0.8) + plate()), black=True),
    PictureCase(
        "light that can't be reached",
        lambda _: scene(fog(0.5, 0.8) + box() + light(z=5.0), "0, -1.2, 0", inside=True),
        black=True,
        shortfall=1e-7,
    ),
    PictureCase("a million triangles in fog", many_triangles),
]

EXTREME_SETTINGS = [
    PictureCase("error 1e-6 in 2 s", plain_from("0, -4, 0"), settings={"error": 1e-6, "time_budget_seconds": 2.0}),
    PictureCase("error 10", plain_from("0, -4, 0"), settings={"error": 10.0}, noisy=True),
    PictureCase("one record", plain_from("0, -4, 0"), settings={"record_budget": 1}),
    PictureCase("0.1 s", plain_from("0, -4, 0"), settings={"time_budget_seconds": 0.1}, noisy=True),
]

CASES = PLAIN + EXTREME_SETTINGS


def luminances(path: Path) -> Luminances:
    """Of an image's pixels."""
    grey = np.asarray(image_error.read(path) @ image_error.LUMINANCE, np.float64)
    if not np.isfinite(grey).all():
        message = "a pixel isn't finite"
        raise ValueError(message)
    return grey


def quarters(grey: Luminances) -> Luminances:
    """Mean luminance of each."""
    half = SIDE // 2
    return np.array([grey[y : y + half, x : x + half].mean() for y in (0, half) for x in (0, half)])


def run_case(case: PictureCase) -> PictureRow:
    """Renders it both ways; bounded in time."""
    with tempfile.TemporaryDirectory(prefix="fogbank-picture-") as name:
        folder = Path(name)
        path = folder / "scene.xml"
        path.write_text(case.scene(folder), encoding="utf-8")
        common = {"width": SIDE, "height": SIDE, "max_depth": case.max_depth, "threads": 2}
        output = folder / "image.exr"
        paths = [case.known()] if case.known else []
        with engines.fogbank() as engine:
            engine.ask("load", scene=str(path))
            for seed in range(0 if case.known else PATH_SEEDS):
                engine.ask(
                    "render",
                    integrator="volpath",
                    samples_per_pixel=PATH_SAMPLES,
                    seed=seed,
                    time_budget_seconds=PATH_SECONDS,
                    output=str(output),
                    **common,
                )
                paths.append(luminances(output))
        settings = {"error": ERROR, **case.settings}
        with engines.fogbank() as engine:
            engine.ask("load", scene=str(path))
            answer = engine.ask(
                "render",
                integrator="radiance-cache",
                samples_per_pixel=1024,
                seed=99,
                output=str(output),
                **common,
                **settings,
            )
        image = luminances(output)
    found = quarters(image)
    path_quarters = [quarters(path) for path in paths]
    path_mean = np.mean(path_quarters, axis=0)
    path_error = np.std(path_quarters, axis=0, ddof=1) / np.sqrt(PATH_SEEDS) if len(paths) > 1 else np.zeros(4)
    scale = max(float(path_mean.mean()), 1e-30)
    difference = float(np.max(np.abs(found - path_mean)) / scale) if path_mean.any() or found.any() else 0.0
    allowed = float(settings["error"] if settings["error"] > ERROR / 10 else ERROR) + STANDARD_ERRORS * float(
        np.max(path_error) / scale
    )
    verdict = ""
    if case.black and found.mean() > case.shortfall:
        verdict = "NOT BLACK"
    elif not case.black and not case.noisy and difference > max(allowed, case.shortfall):
        verdict = "WRONG"
    elif answer["cpu_seconds"] > MOST_SECONDS:
        verdict = "TOO LONG"
    elif answer["peak_bytes"] > MOST_BYTES:
        verdict = "TOO MUCH MEMORY"
    return PictureRow(
        name=case.name,
        cpu_seconds=answer["cpu_seconds"],
        peak_bytes=answer["peak_bytes"],
        records=answer["records_new"],
        path_mean=float(path_mean.mean()),
        cache_mean=float(found.mean()),
        worst_difference=difference,
        allowed=allowed,
        verdict=verdict,
        images=(np.mean(paths, axis=0), image),
    )


def table(rows: list[PictureRow]) -> str:
    """Markdown."""
    lines = [
        "| case | path tracing | cache | worst quarter differs by | allowed | records | CPU s | peak MiB | |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.name} | {row.path_mean:.4g} | {row.cache_mean:.4g} | {row.worst_difference:.3f} |"
            f" {row.allowed:.3f} | {row.records} | {row.cpu_seconds:.2f} | {row.peak_bytes / 2**20:.0f} |"
            f" {row.verdict} |"
        )
    return "\n".join(lines) + "\n"


def plot(path: Path, rows: list[PictureRow]) -> None:
    """All pictures, path tracing's above the cache's; white is the brightest twentieth of a pair."""
    columns = 6
    lines = -(-len(rows) // columns)
    figure = Figure(figsize=(2.2 * columns, 4.9 * lines))
    axes = figure.subplots(2 * lines, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for number, row in enumerate(rows):
        white = max(float(np.quantile(row.images[0], 0.95)), float(np.quantile(row.images[1], 0.95)), 1e-30)
        for below, grey in enumerate(row.images):
            axis = axes[2 * (number // columns) + below][number % columns]
            axis.imshow(np.clip(grey / white, 0.0, 1.0) ** (1 / 2.2), cmap="gray", vmin=0.0, vmax=1.0)
        axes[2 * (number // columns)][number % columns].set_title(
            "\n".join(textwrap.wrap(f"{row.name} {row.verdict}", 26)), fontsize=7
        )
    figure.tight_layout()
    figure.savefig(path, dpi=100)
