"""A triangle mesh with vertex normals, and its binary PLY file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Positions are stored as multiples of 2^-13 (0.12 mm if the unit is a metre) and normals of 2^-10. A
# library that rounds sin or exp differently in the last bit therefore still gives the same bytes.
POSITION_STEPS = 8192.0
NORMAL_STEPS = 1024.0


@dataclass(frozen=True)
class Mesh:
    """positions and normals: (n, 3); triangles: (m, 3), counter-clockwise seen from outside."""

    positions: Array
    normals: Array
    triangles: Indices

    def placed(self, scale: float = 1.0, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
        """A uniformly scaled, then translated copy."""
        return Mesh(self.positions * scale + np.asarray(offset), self.normals, self.triangles)


def merge(meshes: list[Mesh]) -> Mesh:
    """One mesh with the triangles of all; vertices are not shared between the parts."""
    starts = np.cumsum([0] + [len(mesh.positions) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def polygon(corners: Array, normal: Array | None = None) -> Mesh:
    """A flat convex polygon, fanned from its first corner; the normal follows from the winding."""
    if normal is None:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal = normal / np.linalg.norm(normal)
    count = len(corners)
    fan = np.array([[0, i, i + 1] for i in range(1, count - 1)], dtype=np.int64)
    return Mesh(corners.astype(np.float64), np.tile(normal, (count, 1)), fan)


def grid(positions: Array, normals: Array, closed_u: bool = False) -> Mesh:
    """A (rows, columns, 3) lattice of points as triangles; closed_u joins the last column to the first.

    Counter-clockwise means: d/d(row) x d/d(column) points outwards.
    """
    rows, columns = positions.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    after = np.roll(index, -1, axis=1) if closed_u else index[:, 1:]
    here = index if closed_u else index[:, :-1]
    a, b, c, d = here[:-1], here[1:], after[1:], after[:-1]
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    flat = positions.reshape(-1, 3)
    corners = flat[triangles]
    doubled_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Mesh(flat, normals.reshape(-1, 3), triangles[doubled_area > 1e-9])


def write_ply(path: Path, mesh: Mesh) -> None:
    """Little-endian binary PLY: float32 x, y, z, nx, ny, nz; faces as uchar count and int32 indices."""
    lengths = np.linalg.norm(mesh.normals, axis=1, keepdims=True)
    if not np.all(np.isfinite(mesh.positions)) or not np.all(lengths > 0):
        raise ValueError(f"{path}: positions must be finite and normals must not vanish")
    positions = np.round(mesh.positions * POSITION_STEPS) / POSITION_STEPS
    normals = np.round(mesh.normals / lengths * NORMAL_STEPS) / NORMAL_STEPS
    vertices = np.concatenate([positions, normals], axis=1).astype("<f4")
    corners = positions[mesh.triangles]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    triangles = mesh.triangles[np.any(crosses != 0.0, axis=1)]  # rounding may have left some without area
    faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    faces["count"] = 3
    faces["indices"] = triangles
    header = "\n".join(
        ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
        + [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
        + [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(header.encode("ascii") + vertices.tobytes() + faces.tobytes())
