"""How long a scene of a million triangles takes to load, by stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.bench import engines

SIDE = 708  # vertices; 2 * 707^2 = 999 698 triangles

SCENE = """<scene version="3.0.0">
  <integrator type="volpath"/>
  <sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 1, -2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film>
  </sensor>
  <shape type="ply"><string name="filename" value="hills.ply"/></shape>
  <emitter type="constant"/>
</scene>
"""


def write_scene(folder: Path) -> Path:
    """A height field of hills as a binary PLY file, and a scene around it."""
    folder.mkdir(parents=True, exist_ok=True)
    x, z = np.meshgrid(np.linspace(-1, 1, SIDE), np.linspace(-1, 1, SIDE))
    y = 0.1 * np.sin(9 * x) * np.cos(7 * z) + 0.01 * np.sin(90 * x + 70 * z)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype("<f4")
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)[None, :]).ravel()
    triangles = np.concatenate(
        [
            np.stack([corner, corner + SIDE, corner + 1], axis=1),
            np.stack([corner + 1, corner + SIDE, corner + SIDE + 1], axis=1),
        ]
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = triangles
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (folder / "hills.ply").write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())
    scene = folder / "hills.xml"
    scene.write_text(SCENE, encoding="utf-8")
    return scene


def measure(rounds: int) -> dict[str, Any]:
    """The fastest of some rounds: the first one also reads the file from the disk."""
    scene = write_scene(engines.OUTPUT / "hills")
    with engines.fogbank() as engine:
        answers = [engine.ask("load", scene=str(scene)) for _ in range(rounds)]
    return min(answers, key=lambda answer: float(answer["load_seconds"]))


def table(result: dict[str, Any]) -> str:
    """For people."""
    stages = "  ".join(
        f"{name} {result[f'{name}_seconds']:.3f} s" for name in ("parse", "mesh", "texture", "acceleration", "world")
    )
    return f"{result['triangles']:,} triangles: {result['load_seconds']:.3f} s in all\n  {stages}"
