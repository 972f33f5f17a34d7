"""A ball of fog under a sky of 1: radiance from the integral equation of radiative transfer, without a random number.

Light that is scattered alike in all directions has, in a ball of radius R (in mean free paths) and albedo a, a mean
radiance J(r) with (Peierls' equation; Case and Zweifel 1967, "Linear Transport Theory", section 2.7)

    r J(r) = r J_0(r) + a K[s J(s)](r),    K[f](r) = 1/2 integral of (E_1(|r - s|) - E_1(r + s)) f(s) ds over 0 .. R,

J_0 being what comes straight from the sky. As J = 1 solves it for a = 1, the deficit g = r (1 - J) solves

    g - a K[g] = (1 - a) K[s],

which has no J_0 in it and stays well behaved for a near 1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import expn

Numbers = npt.NDArray[np.float64]

CELLS = 1000
STEPS = 2000
LONGEST = 30.0
"""Mean free paths along a ray beyond which nothing is seen: exp(-30) = 1e-13."""


def mean_radiance(radius: float, albedo: float) -> tuple[Numbers, Numbers]:
    """J at the middles of cells between 0 and `radius` (mean free paths): both of shape (CELLS,)."""
    edges = np.linspace(0.0, radius, CELLS + 1)
    r = 0.5 * (edges[:-1] + edges[1:])

    def primitive(x: Numbers) -> Numbers:
        """Of E_1(|x|)."""
        return np.asarray(np.sign(x) * (1.0 - expn(2, np.abs(x))), np.float64)

    far, near = edges[None, 1:], edges[None, :-1]
    column = r[:, None]
    kernel = 0.5 * (primitive(far - column) - primitive(near - column))
    kernel -= 0.5 * (primitive(far + column) - primitive(near + column))
    deficit = np.linalg.solve(np.eye(CELLS) - albedo * kernel, (1.0 - albedo) * (kernel @ r))
    return r, 1.0 - deficit / r


def radiance(offset: Numbers, radius: float, albedo: float) -> Numbers:
    """Along rays that pass the centre at `offset`, in mean free paths, any shape."""
    r, mean = mean_radiance(radius, albedo)
    half = np.sqrt(np.maximum(radius**2 - offset**2, 0.0))
    length = np.minimum(2.0 * half, LONGEST)
    middles = (np.arange(STEPS) + 0.5) / STEPS
    seen = np.ones_like(offset)
    for index in np.ndindex(offset.shape):
        t = length[index] * middles
        where = np.sqrt(offset[index] ** 2 + (half[index] - t) ** 2)
        scattered = albedo * np.interp(where, r, mean) * np.exp(-t)
        seen[index] = np.exp(-2.0 * half[index]) + scattered.sum() * length[index] / STEPS
    return seen


def picture(distance: float, fov_degrees: float, side: int, radius: float, sigma_t: float, albedo: float) -> Numbers:
    """A square picture of shape (side, side): seen from `distance` of its centre, `radius` and it in scene units."""
    subpixels = 3
    at = (2.0 * (np.arange(side * subpixels) + 0.5) / (side * subpixels) - 1.0) * np.tan(np.radians(fov_degrees / 2))
    squared_tangent = at[:, None] ** 2 + at[None, :] ** 2
    offset = distance * np.sqrt(squared_tangent / (1.0 + squared_tangent))
    fine = radiance(offset * sigma_t, radius * sigma_t, albedo)
    return np.asarray(fine.reshape(side, subpixels, side, subpixels).mean(axis=(1, 3)), np.float64)
