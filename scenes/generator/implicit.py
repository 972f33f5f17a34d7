"""Signed-distance modelling and its polygonisation by surface nets.

A shape is a function from points (n, 3) to signed distances (n,), negative inside; it need not be an exact
distance, only smooth near its zero set. Building blocks follow the usual closed forms (distance to a
segment, ellipsoid by its scaled norm, polynomial smooth minimum).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from generator.mesh import Array, Indices, Mesh

Field = Callable[[Array], Array]
Point = tuple[float, float, float]


def ellipsoid(p: Array, centre: Point, radii: Point) -> Array:
    """Approximate distance k0 (k0 - 1) / k1 with k0 = |q / r|, k1 = |q / r^2|."""
    q = (p - np.asarray(centre)) / np.asarray(radii)
    k0 = np.sqrt((q * q).sum(1))
    k1 = np.sqrt(((q / np.asarray(radii)) ** 2).sum(1))
    distance: Array = k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)
    return distance


def limb(p: Array, start: Point, end: Point, start_radius: float, end_radius: float) -> Array:
    """Capsule whose radius goes linearly from start to end."""
    a, b = np.asarray(start), np.asarray(end)
    axis = b - a
    t = np.clip(((p - a) @ axis) / (axis @ axis), 0.0, 1.0)
    gap = p - a - t[:, None] * axis
    distance: Array = np.sqrt((gap * gap).sum(1)) - (start_radius + (end_radius - start_radius) * t)
    return distance


def smooth_union(a: Array, b: Array, width: float) -> Array:
    """Union whose crease is rounded over `width`."""
    h = np.clip(0.5 + 0.5 * (b - a) / width, 0.0, 1.0)
    return b + (a - b) * h - width * h * (1.0 - h)


def smooth_cut(a: Array, b: Array, width: float) -> Array:
    """a without b, the crease rounded over `width`."""
    return -smooth_union(-a, b, width)


def smoothstep(edge0: float, edge1: float, x: Array) -> Array:
    t = np.clip((x - edge0) / (edge1 - edge0), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def gradient(field: Field, points: Array, step: float) -> Array:
    columns = []
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = step
        columns.append((field(points + shift) - field(points - shift)) / (2.0 * step))
    return np.stack(columns, axis=1)


def polygonise(field: Field, low: Point, high: Point, cell: float) -> Mesh:
    """Naive surface nets (Gibson 1998): one vertex in each cell that the surface crosses, at the mean of its
    edge crossings, then three Newton steps onto the surface; normals from the field's gradient."""
    counts = np.ceil((np.asarray(high) - np.asarray(low)) / cell).astype(np.int64) + 1
    axes = [low[k] + cell * np.arange(counts[k]) for k in range(3)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = np.concatenate([field(chunk) for chunk in np.array_split(lattice, 1 + len(lattice) // 200_000)])
    values = values.reshape(tuple(counts))
    inside = values < 0.0
    if any(inside.take(end, axis=k).any() for k in range(3) for end in (0, -1)):
        raise ValueError("the surface leaves the box that is to be polygonised")

    cells = tuple(counts - 1)
    crossing_sum = np.zeros((*cells, 3))
    crossing_count = np.zeros(cells, dtype=np.int64)
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in cells], indexing="ij"), axis=-1).astype(np.float64)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for du in (0, 1):
            for dv in (0, 1):
                begin = [slice(0, n) for n in cells]
                begin[u] = slice(du, du + cells[u])
                begin[v] = slice(dv, dv + cells[v])
                finish = list(begin)
                finish[axis] = slice(1, 1 + cells[axis])
                a, b = values[tuple(begin)], values[tuple(finish)]
                crossed = (a < 0.0) != (b < 0.0)
                t = np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0)
                point = corner.copy()
                point[..., u] += du
                point[..., v] += dv
                point[..., axis] += t
                crossing_sum += np.where(crossed[..., None], point, 0.0)
                crossing_count += crossed
    active = crossing_count > 0
    number = np.full(cells, -1, dtype=np.int64)
    number[active] = np.arange(int(active.sum()))
    points = np.asarray(low) + cell * crossing_sum[active] / crossing_count[active][:, None]

    quads: list[Indices] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        begin = [slice(None)] * 3
        begin[axis] = slice(0, cells[axis])
        finish = list(begin)
        finish[axis] = slice(1, None)
        start_inside, end_inside = inside[tuple(begin)], inside[tuple(finish)]
        for outward in (True, False):
            edges = np.argwhere((start_inside & ~end_inside) if outward else (~start_inside & end_inside))
            around = []
            for du, dv in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
                neighbour = edges.copy()
                neighbour[:, u] += du
                neighbour[:, v] += dv
                around.append(number[tuple(neighbour.T)])
            quads.append(np.stack(around if outward else around[::-1], axis=1))
    quad = np.concatenate(quads)

    for _ in range(3):
        slope = gradient(field, points, 0.05 * cell)
        length2 = np.maximum((slope * slope).sum(1, keepdims=True), 1e-6)
        move = -field(points)[:, None] * slope / length2
        # Half a cell at most: where two parts meet in a crease the linear model may overshoot.
        limit = np.minimum(1.0, 0.5 * cell / np.maximum(np.sqrt((move * move).sum(1, keepdims=True)), 1e-12))
        points = points + move * limit
    # A wider stencil for shading than for the Newton steps: it averages detail below the cell size.
    normals = gradient(field, points, 0.35 * cell)

    corners = points[quad]
    first = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    second = np.linalg.norm(corners[:, 1] - corners[:, 3], axis=1)
    # The tie margin keeps the choice independent of the last bits.
    split = np.where((first <= second + 1e-7 * cell)[:, None], quad, np.roll(quad, -1, axis=1))
    triangles = np.concatenate([split[:, [0, 1, 2]], split[:, [0, 2, 3]]])
    return Mesh(points, normals, triangles)
