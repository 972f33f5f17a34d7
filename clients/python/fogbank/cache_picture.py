"""The picture of a cache: the scene cut open and seen from above, and its records coloured by size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

import fogbank

Colours = npt.NDArray[np.uint8]

# Everything is drawn so many times as large and then reduced, for smooth edges.
_SUPERSAMPLING = 2

# Ellipses beyond this number would only cover each other; all records get a dot.
_MOST_ELLIPSES = 20_000
_ELLIPSE_CORNERS = 40

_PAPER = np.array([250.0, 249.0, 246.0])
_FLOOR = np.array([176.0, 178.0, 184.0])
_SOLID = np.array([58.0, 61.0, 68.0])
_INK = (40, 42, 48)
# From small to large, dark to light in even steps of luminance, so that it also reads without colour.
_SCALE = np.array([(61, 24, 110), (150, 36, 122), (218, 73, 84), (246, 141, 56), (252, 214, 92)], np.float64)

_MARGIN = 28
_LEGEND_HEIGHT = 86


@dataclass(frozen=True)
class _Records:
    """All components together, projected to pixels of the plan; the largest first."""

    centres: npt.NDArray[np.float64]
    """(n, 2)."""

    axes: npt.NDArray[np.float64]
    """(n, 2, 2): conjugate half diameters of each projected ellipsoid."""

    radii: npt.NDArray[np.float64]
    """(n,): scene units."""


def draw(view: fogbank.CacheView) -> Image.Image:
    """The picture with title and legend; as large as the plan plus a margin."""
    plan = _plan_picture(view.plan)
    records = _project(view)
    scale = _SUPERSAMPLING
    canvas = Image.fromarray(plan).resize((plan.shape[1] * scale, plan.shape[0] * scale), Image.Resampling.BICUBIC)
    shades, limits = _shades(records.radii)
    _draw_records(canvas, records, shades, scale)
    canvas = canvas.resize((plan.shape[1], plan.shape[0]), Image.Resampling.LANCZOS)
    picture = Image.new(
        "RGB", (canvas.width + 2 * _MARGIN, canvas.height + 2 * _MARGIN + _LEGEND_HEIGHT), tuple(map(int, _PAPER))
    )
    picture.paste(canvas, (_MARGIN, _MARGIN))
    _draw_legend(picture, canvas.height + _MARGIN, view, limits)
    return picture


def _plan_picture(plan: fogbank.Plan) -> Colours:
    """Floors light, the deeper the darker; slopes shaded; what the cut goes through nearly black; steps outlined."""
    seen = np.isfinite(plan.depth)
    depth = np.where(seen, plan.depth, 0.0).astype(np.float64)
    deepest = float(np.quantile(depth[seen], 0.98)) if seen.any() else 0.0
    depth_share = np.clip(depth / deepest, 0.0, 1.0) if deepest > 0.0 else np.zeros_like(depth)
    light = (1.0 - 0.55 * depth_share) * (0.62 + 0.38 * plan.facing)
    colours = _FLOOR + (_PAPER - _FLOOR) * light[..., None]
    colours[~seen] = _PAPER
    # A step of more than this between neighbouring pixels is an edge; gentler slopes are shaded only.
    step = 3.0 * (plan.extent[1] - plan.extent[0]) / plan.depth.shape[1]
    edge = np.zeros(plan.depth.shape, bool)
    filled = np.where(seen, depth, depth.max(initial=0.0) + 10.0 * step)
    edge[:, 1:] |= np.abs(np.diff(filled, axis=1)) > step
    edge[1:, :] |= np.abs(np.diff(filled, axis=0)) > step
    colours[edge] *= 0.72
    colours[plan.solid] = _SOLID
    rounded: Colours = np.clip(np.rint(colours), 0, 255).astype(np.uint8)
    return rounded


def _project(view: fogbank.CacheView) -> _Records:
    right, down, _ = view.plan.axes
    left, right_border, _, top = view.plan.extent
    pixels = view.plan.depth.shape[1] / (right_border - left)
    centres, axes, radii = [np.zeros((0, 2))], [np.zeros((0, 2, 2))], [np.zeros(0)]
    for extents in view.records:
        flat = extents.positions[:, [right, down]].astype(np.float64)
        centres.append((flat - (left, top)) * pixels)
        axes.append(_silhouettes(extents.semi_axes[:, :, [right, down]].astype(np.float64)) * pixels)
        radii.append(extents.radii.astype(np.float64))
    together = _Records(np.concatenate(centres), np.concatenate(axes), np.concatenate(radii))
    order = np.argsort(-together.radii, kind="stable")
    return _Records(together.centres[order], together.axes[order], together.radii[order])


def _silhouettes(projected: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Half diameters (n, 2, 2) of the ellipses that ellipsoids with semi-axes (n, 3, 2), projected, fill.

    The image of the unit ball under the 2 x 3 matrix A of projected semi-axes is the ellipse of A A^T, whose half
    diameters are its eigenvectors times the roots of its eigenvalues.
    """
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", projected, projected))
    roots = np.sqrt(np.maximum(values, 0.0))
    half: npt.NDArray[np.float64] = np.swapaxes(vectors, 1, 2) * roots[:, :, None]
    return half


def _shades(radii: npt.NDArray[np.float64]) -> tuple[Colours, tuple[float, float]]:
    """Colour (n, 3) of each radius by its logarithm, and the radii at the ends of the scale."""
    positive = radii[radii > 0.0]
    if positive.size == 0:
        return np.zeros((len(radii), 3), np.uint8), (0.0, 0.0)
    smallest, largest = np.quantile(positive, [0.01, 0.99])
    span = max(float(np.log(largest / smallest)), 1e-6)
    share = np.clip(np.log(np.maximum(radii, smallest) / smallest) / span, 0.0, 1.0)
    return _colours(share), (float(smallest), float(largest))


def _colours(share: npt.NDArray[np.float64]) -> Colours:
    """Colours (n, 3) on the scale, share 0 to 1."""
    stops = np.linspace(0.0, 1.0, len(_SCALE))
    channels = [np.interp(share, stops, _SCALE[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def _draw_records(canvas: Image.Image, records: _Records, shades: Colours, scale: int) -> None:
    pen = ImageDraw.Draw(canvas, "RGBA")
    count = len(records.radii)
    angles = np.linspace(0.0, 2.0 * np.pi, _ELLIPSE_CORNERS, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    # The more there are, the fainter each one, so that the plan below stays visible.
    fill = int(np.clip(4000.0 / max(count, 1), 5.0, 46.0))
    outline = int(np.clip(60000.0 / max(count, 1), 34.0, 150.0))
    for index in range(max(0, count - _MOST_ELLIPSES), count):
        corners = (records.centres[index] + circle @ records.axes[index]) * scale
        colour = tuple(int(value) for value in shades[index])
        pen.polygon([tuple(corner) for corner in corners.tolist()], fill=(*colour, fill), outline=(*colour, outline))
    dot = scale * float(np.clip(60.0 / np.sqrt(max(count, 1)), 0.8, 2.2))
    for (x, y), shade in zip((records.centres * scale).tolist(), shades.tolist(), strict=True):
        pen.ellipse((x - dot, y - dot, x + dot, y + dot), fill=(*shade, 235))


def _draw_legend(picture: Image.Image, top: int, view: fogbank.CacheView, limits: tuple[float, float]) -> None:
    pen = ImageDraw.Draw(picture)
    large, small = ImageFont.load_default(size=19), ImageFont.load_default(size=14)
    records = sum(extents.component.records for extents in view.records)
    right, down, up = ("xyz"[axis] for axis in view.plan.axes)
    y = top + 20
    pen.text((_MARGIN, y), f"{records:,} records".replace(",", " "), font=large, fill=_INK)
    by_quantity: dict[str, int] = {}
    for extents in view.records:
        name = extents.component.quantity or "unknown"
        by_quantity[name] = by_quantity.get(name, 0) + extents.component.records
    parts = [f"{count} {name}" for name, count in sorted(by_quantity.items())]
    pen.text((_MARGIN, y + 32), ", ".join(parts), font=small, fill=_INK)
    seen = f"seen down {up}, cut at {up} = {view.plan.cut:.3g}; {right} to the right, {down} down"
    pen.text((_MARGIN, y + 52), seen, font=small, fill=_INK)
    if limits[1] <= 0.0:
        return
    width = min(300, picture.width // 3)
    left = picture.width - _MARGIN - width
    bar = _colours(np.linspace(0.0, 1.0, width))[None].repeat(16, axis=0)
    picture.paste(Image.fromarray(bar), (left, y))
    pen.text((left, y + 22), f"{limits[0]:.3g}", font=small, fill=_INK)
    pen.text((left + width, y + 22), f"{limits[1]:.3g}", font=small, fill=_INK, anchor="ra")
    pen.text((left + width // 2, y + 22), "radius, scene units", font=small, fill=_INK, anchor="ma")
