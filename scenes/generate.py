"""Writes the meshes of the project scenes. Run: python scenes/generate.py [--check] [FOLDER]

numpy only and deterministic: a second run writes the same bytes. With --check nothing is written; the
command fails if a committed file differs from what it would write.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from generator import figures, solids
from generator.implicit import polygonise
from generator.mesh import Mesh, merge, write_ply

SCENES = Path(__file__).resolve().parent

WINDOWS = [(1.0, 2.4), (3.6, 5.0), (6.2, 7.6), (8.8, 10.2)]
SILL, SPRING = 1.3, 3.9


def amphora() -> Mesh:
    """A two-handled jar, 1.15 m tall, with a gadrooned belly."""
    keys = np.array([
        [0.0, 0.0, 0], [0.15, 0.0, 0], [0.165, 0.02, 0], [0.15, 0.05, 0], [0.085, 0.09, 0], [0.1, 0.13, 0],
        [0.2, 0.24, 1], [0.29, 0.42, 1], [0.325, 0.6, 1], [0.3, 0.75, 0.3], [0.21, 0.87, 0], [0.125, 0.94, 0],
        [0.105, 1.0, 0], [0.115, 1.07, 0], [0.16, 1.12, 0], [0.185, 1.13, 0], [0.185, 1.15, 0], [0.15, 1.15, 0],
        [0.11, 1.1, 0], [0.0, 1.05, 0],
    ])  # fmt: skip
    steps = np.linspace(0.0, 1.0, 4)[:-1]
    padded = np.concatenate([keys[:1], keys, keys[-1:]])
    rows = []
    for i in range(1, len(padded) - 2):
        a, b, c, d = padded[i - 1 : i + 3]
        for t in steps:  # Catmull-Rom through the keys
            rows.append(b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a))))
    profile = np.clip(np.array([*rows, keys[-1]]), 0.0, None)
    body = solids.lathe(profile, 72, flutes=18, flute_depth=0.018)
    angle = np.linspace(-0.2, 1.2, 22) * np.pi
    handles = []
    for side in (1.0, -1.0):
        path = np.stack([side * (0.19 + 0.15 * np.sin(angle)), 0.93 - 0.15 * np.cos(angle), 0.0 * angle], axis=1)
        handles.append(solids.tube(path, 0.024 + 0.008 * np.cos(2 * angle), 12, closed=False))
    return merge([body, *handles])


def column() -> Mesh:
    """A fluted column with base and capital, 5.2 m tall."""
    shaft = [[0.235 - 0.035 * t**2, 0.32 + 4.36 * t, 1.0] for t in np.linspace(0.0, 1.0, 12)]
    profile = np.array([
        [0.0, 0.0, 0], [0.36, 0.0, 0], [0.36, 0.1, 0], [0.34, 0.1, 0], [0.36, 0.14, 0], [0.345, 0.19, 0],
        [0.29, 0.21, 0], [0.3, 0.25, 0], [0.28, 0.28, 0], [0.24, 0.3, 0], *shaft,
        [0.21, 4.7, 0], [0.235, 4.72, 0], [0.235, 4.76, 0], [0.215, 4.78, 0], [0.24, 4.84, 0], [0.31, 4.95, 0],
        [0.37, 5.0, 0], [0.37, 5.2, 0], [0.0, 5.2, 0],
    ])  # fmt: skip
    return solids.lathe(profile, 80, flutes=20, flute_depth=0.022)


def knot() -> Mesh:
    """A trefoil knot of 0.9 m, standing on the plane y = 0."""
    t = np.arange(220) * (2 * np.pi / 220)
    path = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    ring = solids.tube(0.15 * path, 0.068 + 0.018 * np.cos(3 * t), 18, closed=True)
    return ring.placed(offset=(0.0, -float(np.round(ring.positions[:, 1].min(), 4)), 0.0))


def window_bars() -> Mesh:
    """Mullion and three transoms in each arched window of the hall."""
    bars = []
    for x0, x1 in WINDOWS:
        middle, radius = 0.5 * (x0 + x1), 0.5 * (x1 - x0)
        top = SPRING + radius
        bars.append(solids.bevelled_box((middle, 0.5 * (SILL + top), -0.15), (0.05, 0.5 * (top - SILL), 0.05), 0.012))
        for y in (SILL + 0.87, SILL + 1.73, SPRING):
            bars.append(solids.bevelled_box((middle, y, -0.15), (radius, 0.04, 0.04), 0.01))
    return merge(bars)


def steps() -> Mesh:
    """Eleven floating treads that rise along +x."""
    return merge(
        [solids.bevelled_box((1.55 + 0.3 * i, 0.2 * (i + 1), 1.05), (0.19, 0.05, 0.75), 0.012) for i in range(11)]
    )


def slats() -> Mesh:
    """Louvre boards of the stair window, in the wall x = 0, tilted so that they pass about 60 % of the sun."""
    heights = 1.32 + 0.5 * np.arange(7)
    return merge([solids.bevelled_box((-0.14, float(y), 1.2), (0.21, 0.018, 0.5), 0.006, -0.3) for y in heights])


def cage() -> Mesh:
    """Bars around the lamp in the cloud: three rings through the poles and one about the waist."""
    t = np.arange(72) * (2 * np.pi / 72)
    circle = np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1)
    rings = []
    for turn in (0.0, np.pi / 3, 2 * np.pi / 3):
        spun = np.stack([circle[:, 0] * np.cos(turn), circle[:, 1], -circle[:, 0] * np.sin(turn)], axis=1)
        rings.append(solids.tube(0.17 * spun, np.full(72, 0.014), 8, closed=True))
    rings.append(solids.tube(0.17 * circle[:, [0, 2, 1]], np.full(72, 0.014), 8, closed=True))
    return merge(rings)


def meshes() -> dict[str, Mesh]:
    """Every committed mesh by its path below scenes/."""
    return {
        "shafts/meshes/winged_figure.ply": polygonise(
            figures.winged_figure, (-1.25, -0.1, -0.75), (1.25, 2.9, 0.6), 0.044
        ),
        "shafts/meshes/bust.ply": polygonise(figures.bust, (-0.4, -0.05, -0.35), (0.4, 1.1, 0.35), 0.0172),
        "shafts/meshes/amphora.ply": amphora(),
        "shafts/meshes/knot.ply": knot(),
        "shafts/meshes/column.ply": column(),
        "shafts/meshes/window_wall.ply": solids.arched_wall(12.0, 6.0, 0.3, WINDOWS, SILL, SPRING),
        "shafts/meshes/window_bars.ply": window_bars(),
        "shafts/meshes/ceiling.ply": solids.pierced_slab(12.0, 7.0, 0.25, (3.2, 3.3), 0.62),
        "glow/meshes/cloud.ply": polygonise(figures.cloud, (-1.25, -0.6, -0.85), (1.3, 0.85, 0.85), 0.038),
        "glow/meshes/cage.ply": cage(),
        "stairs/meshes/steps.ply": steps(),
        "stairs/meshes/slats.ply": slats(),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description="Write the meshes of the project scenes.")
    parser.add_argument("folder", nargs="?", type=Path, default=SCENES, help="where to write; default: scenes/")
    parser.add_argument("--check", action="store_true", help="write nothing, compare with the files in FOLDER")
    arguments = parser.parse_args()
    differing = []
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch) if arguments.check else arguments.folder
        for name, mesh in meshes().items():
            write_ply(target / name, mesh)
            size = (target / name).stat().st_size
            print(f"{name}: {len(mesh.positions)} vertices, {len(mesh.triangles)} triangles, {size} bytes")
            if arguments.check:
                committed = arguments.folder / name
                if not committed.is_file() or committed.read_bytes() != (target / name).read_bytes():
                    differing.append(name)
    for name in differing:
        print(f"{name}: differs from the generator's output", file=sys.stderr)
    return 1 if differing else 0


if __name__ == "__main__":
    raise SystemExit(main())
