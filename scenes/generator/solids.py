"""Architecture and vessels: boxes with bevelled edges, lathed profiles, tubes, pierced slabs."""

from __future__ import annotations

import itertools

import numpy as np

from generator.mesh import Array, Mesh, grid, merge, polygon

Point = tuple[float, float, float]


def bevelled_box(centre: Point, half: Point, bevel: float, turn_z: float = 0.0) -> Mesh:
    """A box whose edges are cut by `bevel`, turned about z by `turn_z` radians, flat shaded."""
    h, inner = np.asarray(half), np.asarray(half) - bevel
    parts = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            face = np.zeros((4, 3))
            face[:, axis] = side * h[axis]
            face[:, u] = inner[u] * np.array([-1, 1, 1, -1]) * side
            face[:, v] = inner[v] * np.array([-1, -1, 1, 1])
            parts.append(polygon(face))
        for su in (-1.0, 1.0):  # the four edges along `axis`
            for sv in (-1.0, 1.0):
                edge = np.zeros((4, 3))
                edge[:, axis] = inner[axis] * np.array([-1, -1, 1, 1])
                edge[:, u] = su * np.array([h[u], inner[u], inner[u], h[u]])
                edge[:, v] = sv * np.array([inner[v], h[v], h[v], inner[v]])
                parts.append(polygon(edge if su * sv < 0 else edge[::-1]))
    for sx in (-1.0, 1.0):
        for sy in (-1.0, 1.0):
            for sz in (-1.0, 1.0):
                sign = np.array([sx, sy, sz])
                tip = (inner + np.diag(h - inner)) * sign
                parts.append(polygon(tip if sx * sy * sz > 0 else tip[::-1]))
    box = merge(parts)
    c, s = np.cos(turn_z), np.sin(turn_z)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(box.positions @ turn.T + np.asarray(centre), box.normals @ turn.T, box.triangles)


def lathe(profile: Array, segments: int, flutes: int = 0, flute_depth: float = 0.0) -> Mesh:
    """Turns a profile of (radius, height) rows, bottom first, about the y axis.

    Flutes are rounded grooves, `flute_depth` deep where the third profile column (0 to 1) is 1.
    """
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    radius, height = profile[:, :1], profile[:, 1:2]
    weight = profile[:, 2:3] if profile.shape[1] > 2 else np.zeros_like(radius)
    groove = flute_depth * np.abs(np.sin(0.5 * flutes * angle))[None, :] ** 0.7 * weight
    r = radius - groove
    points = np.stack([r * np.cos(angle), np.broadcast_to(height, r.shape), -r * np.sin(angle)], axis=-1)
    along = np.gradient(points, axis=0)
    around = np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1)
    normals = np.cross(around, along)
    lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
    # On the axis the ring shrinks to a point; its normal is the axis itself.
    pole = np.array([0.0, 1.0, 0.0]) * np.where(height > height.mean(), 1.0, -1.0)[..., None]
    normals = np.where(lengths > 1e-9, normals / np.maximum(lengths, 1e-9), pole)
    turned = grid(points, normals, closed_u=True)
    return Mesh(turned.positions, turned.normals, turned.triangles[:, ::-1])


def tube(path: Array, radii: Array, segments: int, closed: bool) -> Mesh:
    """Sweeps a circle along a polyline with rotation-minimising frames (projection of the last frame)."""
    count = len(path)
    tangent = np.roll(path, -1, 0) - np.roll(path, 1, 0) if closed else np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frame = np.zeros((count, 3))
    seed = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    for i in range(count):
        seed = seed - tangent[i] * (seed @ tangent[i])
        seed = seed / np.linalg.norm(seed)
        frame[i] = seed
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    if closed:  # spread the frame's holonomy over the loop, so that the seam closes
        end = frame[-1] - tangent[0] * (frame[-1] @ tangent[0])
        end /= np.linalg.norm(end)
        twist = np.arctan2(np.cross(end, frame[0]) @ tangent[0], end @ frame[0])
        turn = twist * np.arange(count)[:, None] / (count - 1)
    else:
        turn = np.zeros((count, 1))
    binormal = np.cross(tangent, frame)
    phase = angle[None, :] + turn
    normals = np.cos(phase)[..., None] * frame[:, None] + np.sin(phase)[..., None] * binormal[:, None]
    points = path[:, None] + radii[:, None, None] * normals
    if closed:
        points, normals = np.concatenate([points, points[:1]]), np.concatenate([normals, normals[:1]])
    swept = grid(points, normals, closed_u=True)
    return Mesh(swept.positions, swept.normals, swept.triangles[:, ::-1])


def arched_wall(
    width: float, height: float, thickness: float, windows: list[tuple[float, float]], sill: float, spring: float
) -> Mesh:
    """A wall in z = -thickness .. 0 over x = 0 .. width, y = 0 .. height, pierced by round-arched windows
    (x0, x1 each); the room is at z > 0. Piers are split at sill and spring, so edges match without T-joints."""
    parts: list[Mesh] = []

    def both_faces(outline: list[tuple[float, float]]) -> None:
        front = np.array([[x, y, 0.0] for x, y in outline])
        back = np.array([[x, y, -thickness] for x, y in outline])[::-1]
        parts.extend([polygon(front), polygon(back)])

    def pier(x0: float, x1: float) -> None:
        for y0, y1 in ((0.0, sill), (sill, spring), (spring, height)):
            both_faces([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])

    left = 0.0
    for x0, x1 in windows:
        pier(left, x0)
        left = x1
        both_faces([(x0, 0.0), (x1, 0.0), (x1, sill), (x0, sill)])
        centre, radius = 0.5 * (x0 + x1), 0.5 * (x1 - x0)
        angle = np.linspace(np.pi, 0.0, 25)
        arch = np.stack([centre + radius * np.cos(angle), spring + radius * np.sin(angle)], axis=1)
        arch[0], arch[-1] = (x0, spring), (x1, spring)
        for a, b in itertools.pairwise(arch):
            both_faces([(a[0], a[1]), (b[0], b[1]), (b[0], height), (a[0], height)])
        opening = np.concatenate([[[x0, sill]], arch, [[x1, sill]], [[x0, sill]]])
        for a, b in itertools.pairwise(opening):
            strip = np.array([[*a, 0.0], [*a, -thickness], [*b, -thickness], [*b, 0.0]])
            parts.append(polygon(strip[::-1]))
    pier(left, width)
    return merge(parts)


def pierced_slab(width: float, depth: float, thickness: float, hole: tuple[float, float], radius: float) -> Mesh:
    """A ceiling over x = 0 .. width, z = 0 .. depth from y = 0 up to `thickness` with a round hole."""
    centre = np.asarray(hole)
    corners = np.array([[0, 0], [width, 0], [width, depth], [0, depth]], dtype=np.float64) - centre
    angles = np.concatenate([np.arange(64) * (2 * np.pi / 64), np.arctan2(corners[:, 1], corners[:, 0]) % (2 * np.pi)])
    angles = np.unique(np.round(angles, 9))
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = -centre, np.array([width, depth]) - centre
    parallel = np.abs(direction) < 1e-12
    slope = np.where(parallel, 1.0, direction)
    reach = np.where(parallel, np.inf, np.where(direction > 0, high / slope, low / slope)).min(axis=1)
    inner, outer = centre + radius * direction, centre + reach[:, None] * direction
    parts: list[Mesh] = []
    for i in range(len(angles)):
        j = (i + 1) % len(angles)
        ring = [inner[i], outer[i], outer[j], inner[j]]
        below = np.array([[x, 0.0, z] for x, z in ring])
        above = np.array([[x, thickness, z] for x, z in ring[::-1]])
        rim = [(inner[i], 0.0), (inner[j], 0.0), (inner[j], thickness), (inner[i], thickness)]
        drum = np.array([[x, y, z] for (x, z), y in rim])
        parts.extend([polygon(below), polygon(above), polygon(drum)])
    return merge(parts)
