"""Writes textures, meshes and the environment map of the oracle scenes: python tests/oracle/assets.py [FOLDER]"""

from __future__ import annotations

import argparse
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float64]
FOLDER = Path(__file__).resolve().parent / "scenes" / "assets"


def torus(rows: int, columns: int) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Positions, normals, uv and quads of a torus about the y axis; the seams carry vertices of their own."""
    u, v = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    a, b = 2 * np.pi * u, 2 * np.pi * v
    ring = 0.62 + 0.3 * np.cos(b)
    positions = np.stack([ring * np.cos(a), 0.3 * np.sin(b), ring * np.sin(a)], -1).reshape(-1, 3)
    normals = np.stack([np.cos(b) * np.cos(a), np.sin(b), np.cos(b) * np.sin(a)], -1).reshape(-1, 3)
    index = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(-1, 4)
    return positions, normals, np.stack([4 * u, 2 * v], -1).reshape(-1, 2), quads


def write_obj(path: Path) -> None:
    """Quads with uv and normals, and a triangle that reuses positions with a normal of its own."""
    positions, normals, uv, quads = torus(14, 8)
    lines = ["# A torus of quads around a triangle."]
    lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in positions]
    lines += [f"vt {s:.5f} {t:.5f}" for s, t in uv]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in normals]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}/{i + 1}" for i in quad) for quad in quads]
    last = len(positions)
    lines += ["v -0.3 -0.2 0.05", "v 0.3 -0.2 0.05", "v 0 0.3 0.05", "vt 0 0", "vt 1 0", "vt 0.5 1", "vn 0 0 1"]
    lines += ["f " + " ".join(f"{last + i}/{last + i}/{last + 1}" for i in (1, 2, 3))]
    path.write_text("\n".join(lines) + "\n")


def write_binary_ply(path: Path) -> None:
    """Little-endian, with normals and uv (s, t), triangles."""
    positions, normals, uv, quads = torus(16, 10)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("indices", "<i4", (3,))])
    faces["count"], faces["indices"] = 3, triangles
    vertices = np.concatenate([positions, normals, uv], 1).astype("<f4")
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())


def write_ascii_ply(path: Path) -> None:
    """An octahedron of triangles without normals: face normals are all that is defined."""
    corners = [(0.7, 0, 0), (-0.7, 0, 0), (0, 0.9, 0), (0, -0.9, 0), (0, 0, 0.7), (0, 0, -0.7)]
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    lines = ["ply", "format ascii 1.0", "comment octahedron", f"element vertex {len(corners)}"]
    lines += [f"property float {name}" for name in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, corner)) for corner in corners] + [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")


def write_serialized(path: Path) -> None:
    """Mitsuba's zlib mesh format, version 4: shape 0 in double precision with face normals, shape 1 a torus in
    single precision with vertex normals and uv; then the offsets and the count of shapes."""
    positions, normals, uv, quads = torus(12, 8)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype("<u4")
    tetrahedron = np.array([(0.8, 0.8, 0.8), (-0.8, -0.8, 0.8), (-0.8, 0.8, -0.8), (0.8, -0.8, -0.8)])
    sides = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)], dtype="<u4")
    has_normals, has_uv, face_normals, single, double = 0x1, 0x2, 0x10, 0x1000, 0x2000
    shapes = [
        (double | face_normals, b"tetrahedron", 4, sides, tetrahedron.astype("<f8").tobytes()),
        (
            single | has_normals | has_uv,
            b"torus",
            len(positions),
            triangles,
            b"".join(part.astype("<f4").tobytes() for part in (positions, normals, uv)),
        ),
    ]
    blob, offsets = b"", []
    for flags, name, vertex_count, faces, data in shapes:
        offsets.append(len(blob))
        body = struct.pack("<I", flags) + name + b"\0" + struct.pack("<QQ", vertex_count, len(faces))
        blob += struct.pack("<HH", 0x041C, 4) + zlib.compress(body + data + faces.tobytes(), 9)
    blob += b"".join(struct.pack("<Q", offset) for offset in offsets) + struct.pack("<I", len(offsets))
    path.write_bytes(blob)


def save_png(path: Path, values: Array) -> None:
    Image.fromarray(np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)).save(path, optimize=True)


def write_textures(folder: Path) -> None:
    y, x = np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(16) + 0.5) / 16, indexing="ij")
    ramp = np.stack([0.15 + 0.8 * x, 0.2 + 0.7 * y, 0.9 - 0.6 * x * y], -1)
    ramp[2:5, 3:9] = (0.9, 0.1, 0.1)  # tells up from down and left from right
    save_png(folder / "colours.png", ramp)
    save_png(folder / "opacity.png", 0.5 + 0.5 * np.sign(np.sin(6 * np.pi * x) * np.sin(4 * np.pi * y)) * 0.9)
    y, x = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(32) + 0.5) / 32, indexing="ij")
    save_png(folder / "height.png", 0.5 + 0.5 * np.sin(4 * np.pi * x) * np.cos(4 * np.pi * y))
    slope = np.stack([0.5 * np.cos(4 * np.pi * x), 0.4 * np.sin(6 * np.pi * y), np.ones_like(x)], -1)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    save_png(folder / "normals.png", 0.5 + 0.5 * slope)


def write_environment(path: Path) -> None:
    """32 x 16 latitude-longitude: a sky gradient, a dark ground, a bright patch and a coloured one."""
    v, u = np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(32) + 0.5) / 32, indexing="ij")
    sky = np.stack([0.25 + 0.2 * v, 0.35 + 0.2 * v, 0.7 - 0.3 * v], -1)
    pixels = np.where((v < 0.5)[..., None], sky, np.array([0.12, 0.1, 0.08]))
    pixels[3:5, 7:10] = (14.0, 12.0, 9.0)
    pixels[6:8, 20:24] = (0.4, 2.5, 0.8)
    rgb = np.ascontiguousarray((pixels + 0.0 * u[..., None]).astype(np.float32))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": rgb}).write(str(path))


def main() -> int:
    parser = argparse.ArgumentParser(description="Write the assets of the oracle scenes.")
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    write_obj(folder / "torus.obj")
    write_binary_ply(folder / "torus.ply")
    write_ascii_ply(folder / "octahedron.ply")
    write_serialized(folder / "two_shapes.serialized")
    write_textures(folder)
    write_environment(folder / "sky.exr")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
