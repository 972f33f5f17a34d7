"""Pictures of extreme scenes by the radiance cache, held against path tracing of the same scene.

Both are rendered at 24 x 24 pixels in a process of their own, which gives its peak memory. What is compared is the mean
luminance of each quarter of the picture: path tracing's with the standard error of repeated seeds, the cache's with the
error that it was asked for.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from fogbank.comparison import image_error

from tests.bench import engines

SIDE = 24
ERROR = 0.05
"""Asked for where the case doesn't say otherwise."""
STANDARD_ERRORS = 5.0
"""Of path tracing: 4 quarters of 20 pictures leave one in 20,000 of runs beyond."""
PATH_SAMPLES = 64
PATH_SEEDS = 8
MOST_SECONDS = 120.0
MOST_BYTES = 1 << 30


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


def fog(sigma_t: float, albedo: float, half: float = 1.5) -> str:
    """A cube of fog."""
    return f"""
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="{sigma_t!r}"/><rgb name="albedo" value="{albedo!r}"/><phase type="isotropic"/>
  </medium>
  <shape type="cube"><transform name="to_world"><scale value="{half!r}"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>"""


def scene(body: str, origin: str = "0, -4, 0", target: str = "0, 0, 0", *, inside: bool = False) -> str:
    """A whole file around shapes and media."""
    medium = '<ref name="medium" id="fog"/>' if inside else ""
    return f"""<scene version="3.0.0">
  <integrator type="volpath"/>
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


PLAIN = [
    PictureCase("albedo 0.9999, optical depth 100", lambda _: scene(fog(33.3, 0.9999) + light(z=1.6)), max_depth=-1),
    PictureCase("optical depth 1e-4", lambda _: scene(fog(3.3e-5, 0.8) + light() + plate())),
    PictureCase("optical depth 1e4", lambda _: scene(fog(3.3e3, 0.8) + light(z=1.6) + plate(z=-1.45)), max_depth=64),
    PictureCase(
        "penumbra 1000 times narrower than the room",
        lambda _: scene(fog(0.5, 0.8) + light(half=0.003, radiance=1e5) + plate(z=0.0)),
    ),
    PictureCase("sun of 0.27 degrees through a hole of 1 cm", sun_through_hole),
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
        lambda _: scene(fog(0.5, 0.8) + light() + box(), origin="0, -1.45, 0"),
    ),
    PictureCase("camera inside the medium", plain_from("0, -1, 0", inside=True)),
    PictureCase("camera outside the medium", plain_from("0, -4, 0")),
    PictureCase("camera on the boundary", plain_from("0, -1.5, 0", inside=True)),
    PictureCase("empty scene", lambda _: scene(""), black=True),
    PictureCase("medium without light", lambda _: scene(fog(0.5, 0.8) + plate()), black=True),
    PictureCase("light that can't be reached", lambda _: scene(fog(0.5, 0.8) + box() + light(z=5.0)), black=True),
    PictureCase("a million triangles in fog", many_triangles),
]

EXTREME_SETTINGS = [
    PictureCase("error 1e-6 in 2 s", PLAIN[8].scene, settings={"error": 1e-6, "time_budget_seconds": 2.0}),
    PictureCase("error 10", PLAIN[8].scene, settings={"error": 10.0}, noisy=True),
    PictureCase("one record", PLAIN[8].scene, settings={"record_budget": 1}),
    PictureCase("0.1 s", PLAIN[8].scene, settings={"time_budget_seconds": 0.1}, noisy=True),
]

CASES = PLAIN + EXTREME_SETTINGS


def quarters(path: Path) -> npt.NDArray[np.float64]:
    """Mean luminance of each."""
    grey = image_error.read(path) @ image_error.LUMINANCE
    if not np.isfinite(grey).all():
        message = "a pixel isn't finite"
        raise ValueError(message)
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
        paths = []
        with engines.fogbank() as engine:
            engine.ask("load", scene=str(path))
            for seed in range(PATH_SEEDS):
                engine.ask(
                    "render",
                    integrator="volpath",
                    samples_per_pixel=PATH_SAMPLES,
                    seed=seed,
                    output=str(output),
                    **common,
                )
                paths.append(quarters(output))
        settings = {"error": ERROR, **case.settings}
        start = time.monotonic()
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
        seconds = time.monotonic() - start
        found = quarters(output)
    path_mean = np.mean(paths, axis=0)
    path_error = np.std(paths, axis=0, ddof=1) / np.sqrt(PATH_SEEDS)
    scale = max(float(path_mean.mean()), 1e-30)
    difference = float(np.max(np.abs(found - path_mean)) / scale) if path_mean.any() or found.any() else 0.0
    allowed = float(settings["error"] if settings["error"] > ERROR / 10 else ERROR) + STANDARD_ERRORS * float(
        np.max(path_error) / scale
    )
    verdict = ""
    if case.black and found.any():
        verdict = "NOT BLACK"
    elif not case.black and not case.noisy and difference > allowed:
        verdict = "WRONG"
    elif seconds > MOST_SECONDS:
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
