"""The statues and other freely shaped bodies, as signed-distance fields (see implicit.py). Units: metres."""

from __future__ import annotations

import numpy as np

from generator.implicit import ellipsoid, limb, smooth_cut, smooth_union, smoothstep
from generator.mesh import Array


def _head(p: Array, scale: float) -> Array:
    """A head whose neck joint is at the origin, looking along +z; `scale` 1 is 25 cm tall."""
    q = p / scale
    skull = ellipsoid(q, (0.0, 0.155, -0.008), (0.078, 0.1, 0.098))
    jaw = ellipsoid(q, (0.0, 0.085, 0.028), (0.054, 0.07, 0.062))
    face = smooth_union(skull, jaw, 0.035)
    mirrored = q.copy()
    mirrored[:, 0] = np.abs(q[:, 0])
    brow = limb(mirrored, (0.0, 0.15, 0.088), (0.05, 0.152, 0.07), 0.014, 0.012)
    face = smooth_union(face, brow, 0.02)
    face = smooth_cut(face, ellipsoid(mirrored, (0.031, 0.132, 0.098), (0.02, 0.013, 0.022)), 0.014)
    face = smooth_union(face, ellipsoid(mirrored, (0.031, 0.131, 0.073), (0.015, 0.01, 0.012)), 0.006)
    face = smooth_union(face, ellipsoid(mirrored, (0.042, 0.095, 0.062), (0.02, 0.022, 0.018)), 0.03)
    face = smooth_union(face, limb(q, (0.0, 0.146, 0.092), (0.0, 0.104, 0.112), 0.009, 0.014), 0.012)
    lips = ellipsoid(q, (0.0, 0.073, 0.086), (0.024, 0.011, 0.012))
    face = smooth_union(face, lips, 0.008)
    face = smooth_cut(face, limb(q, (-0.022, 0.073, 0.1), (0.022, 0.073, 0.1), 0.0035, 0.0035), 0.006)
    face = smooth_union(face, ellipsoid(q, (0.0, 0.033, 0.07), (0.022, 0.018, 0.018)), 0.018)
    face = smooth_union(face, ellipsoid(mirrored, (0.078, 0.12, 0.0), (0.01, 0.028, 0.018)), 0.008)
    # Wavy hair, parted in the middle, with a knot at the nape.
    wave = 0.0045 * np.sin(95.0 * q[:, 1] + 55.0 * np.abs(q[:, 0]) + 40.0 * q[:, 2])
    hair = ellipsoid(q, (0.0, 0.172, -0.026), (0.088, 0.098, 0.1)) - wave
    hair = smooth_cut(hair, ellipsoid(q, (0.0, 0.085, 0.105), (0.085, 0.115, 0.09)), 0.02)
    hair = smooth_union(hair, ellipsoid(q, (0.0, 0.13, -0.125), (0.045, 0.042, 0.04)) - wave, 0.02)
    return scale * smooth_union(face, hair, 0.008)


def winged_figure(p: Array) -> Array:
    """A striding woman in a wind-blown robe with raised wings; feet at y = 0, about 2.5 m to the wing tips."""
    x, y, z = p[:, 0], p[:, 1], p[:, 2]
    # Robe: an elliptic cone that trails behind; folds follow the angle and run out towards the belt.
    centre_z = -0.16 * smoothstep(1.05, 0.0, y) ** 1.5
    angle = np.arctan2(x, z - centre_z + 1e-12)
    profile = 0.16 + 0.19 * smoothstep(1.12, 0.0, y) ** 0.9
    folds = smoothstep(1.05, 0.45, y) * (
        0.022 * np.sin(13.0 * angle + 3.0 * np.sin(2.6 * y)) + 0.012 * np.sin(23.0 * angle - 4.0 * y)
    )
    across = np.sqrt(x**2 + ((z - centre_z) / 0.92) ** 2)
    robe = np.maximum(0.8 * (across - profile - folds), np.maximum(0.02 - y, y - 1.12))
    thigh = limb(p, (0.08, 1.0, 0.02), (0.1, 0.58, 0.24), 0.13, 0.1)
    shin = limb(p, (0.1, 0.58, 0.24), (0.1, 0.06, 0.22), 0.1, 0.08)
    body = smooth_union(robe, smooth_union(thigh, shin, 0.05), 0.09)
    overfold = ellipsoid(p, (0.0, 1.02, 0.0), (0.215, 0.13, 0.175)) - 0.012 * np.sin(17.0 * angle + 6.0 * y)
    body = smooth_union(body, overfold, 0.03)
    pleats = 0.006 * np.sin(60.0 * x + 14.0 * y)
    chest = limb(p, (0.0, 1.1, 0.0), (0.0, 1.4, 0.02), 0.125, 0.15) - pleats
    mirrored = p.copy()
    mirrored[:, 0] = np.abs(x)
    chest = smooth_union(chest, ellipsoid(mirrored, (0.075, 1.36, 0.115), (0.072, 0.075, 0.065)), 0.05)
    chest = smooth_union(chest, limb(mirrored, (0.0, 1.5, 0.0), (0.17, 1.485, 0.0), 0.075, 0.068), 0.06)
    body = smooth_union(body, chest, 0.04)
    # The right arm raised, the left swept down and back.
    raised = smooth_union(
        limb(p, (-0.18, 1.48, 0.0), (-0.37, 1.66, 0.12), 0.06, 0.048),
        limb(p, (-0.37, 1.66, 0.12), (-0.36, 1.9, 0.26), 0.047, 0.034),
        0.03,
    )
    lowered = smooth_union(
        limb(p, (0.18, 1.48, 0.0), (0.31, 1.22, -0.04), 0.06, 0.047),
        limb(p, (0.31, 1.22, -0.04), (0.36, 1.0, 0.1), 0.046, 0.033),
        0.03,
    )
    body = smooth_union(body, np.minimum(raised, lowered), 0.03)
    body = smooth_union(body, limb(p, (0.0, 1.5, 0.01), (0.0, 1.64, 0.03), 0.062, 0.052), 0.05)
    body = smooth_union(body, _head(p - np.array([0.0, 1.6, 0.03]), 0.98), 0.02)
    # Wings: curved plates in the half plane (outwards, up) behind the shoulders, feathered at the lower rim.
    out = np.abs(x) - 0.06
    bend = -0.1 - 0.5 * out + 0.22 * out**2
    rise = y - 1.38
    spread = np.sqrt(out**2 + rise**2)
    direction = np.arctan2(rise, out + 1e-12)
    reach = (0.5 + 0.92 * smoothstep(0.0, 1.05, direction)) * (1.0 + 0.05 * np.abs(np.sin(13.0 * direction)))
    plane = np.maximum(0.7 * (spread - reach), 0.6 * spread * (np.abs(direction - 0.6) - 0.66))
    plane = np.maximum(plane, -out - 0.03)
    feathers = 0.009 * np.sin(30.0 * direction) + 0.006 * np.sin(26.0 * spread)
    plate = 0.85 * np.abs(z - bend) - 0.036 - feathers
    return smooth_union(body, np.maximum(plane, plate), 0.05)


def bust(p: Array) -> Array:
    """Head, neck and shoulders on a turned foot; foot at y = 0, about 0.95 m tall."""
    y = p[:, 1]
    head = _head(p - np.array([0.0, 0.48, 0.02]), 1.75)
    neck = limb(p, (0.0, 0.4, -0.01), (0.0, 0.6, 0.0), 0.115, 0.095)
    mirrored = p.copy()
    mirrored[:, 0] = np.abs(p[:, 0])
    shoulders = limb(mirrored, (0.0, 0.34, -0.02), (0.19, 0.28, -0.03), 0.11, 0.1)
    chest = ellipsoid(mirrored, (0.06, 0.26, 0.03), (0.17, 0.15, 0.12))
    torso = smooth_union(smooth_union(shoulders, chest, 0.06), neck, 0.07)
    drape = 0.011 * np.sin(46.0 * (p[:, 0] * 0.55 + y) + 5.0 * np.sin(7.0 * p[:, 0]))
    torso = torso - drape * smoothstep(0.44, 0.36, y)
    torso = smooth_cut(torso, ellipsoid(p, (0.0, 0.0, 0.0), (0.6, 0.16, 0.6)), 0.03)
    across = np.sqrt(p[:, 0] ** 2 + p[:, 2] ** 2)
    stem = np.maximum(
        across - (0.07 + 0.05 * smoothstep(0.1, 0.02, y) + 0.05 * smoothstep(0.12, 0.24, y)),
        np.maximum(0.012 - y, y - 0.26),
    )
    return smooth_union(smooth_union(torso, stem, 0.03), head, 0.03)


def cloud(p: Array) -> Array:
    """A cumulus of overlapping puffs about the origin, flat below, within 2.2 x 1.3 x 1.3."""
    puffs = [
        (0.0, 0.0, 0.0, 0.48), (-0.48, -0.06, 0.05, 0.37), (0.5, -0.05, -0.04, 0.4), (0.2, 0.28, 0.05, 0.34),
        (-0.24, 0.24, -0.05, 0.33), (-0.78, -0.16, 0.0, 0.24), (0.84, -0.16, 0.04, 0.25), (0.05, -0.1, 0.34, 0.3),
        (-0.1, 0.02, -0.32, 0.31), (0.48, 0.13, 0.2, 0.26), (-0.5, 0.12, 0.2, 0.22), (0.02, 0.43, -0.02, 0.21),
    ]  # centre and radius of each  # fmt: skip
    body = np.full(len(p), 1e9)
    for cx, cy, cz, radius in puffs:
        offset = p - np.array([cx, cy, cz])
        body = smooth_union(body, np.sqrt((offset * offset).sum(1)) - radius, 0.06)
    bumps = 0.028 * np.sin(9.0 * p[:, 0] + 1.0) * np.sin(10.0 * p[:, 1] + 2.0) * np.sin(9.0 * p[:, 2])
    bumps = bumps + 0.014 * np.sin(19.0 * p[:, 0]) * np.sin(21.0 * p[:, 1] + 1.0) * np.sin(20.0 * p[:, 2] + 0.5)
    floor = -0.34 - p[:, 1]  # positive below the flat base; intersect with a rounded rim
    return -smooth_union(-(body - bumps), -floor, 0.14)
