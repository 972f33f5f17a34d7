"""The scenes of scenes/analytic against their closed forms, and these against numerical integration."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fogbank import Service
from numpy.typing import NDArray

from tests.oracle import zcheck
from tests.oracle.cases import REPOSITORY
from tests.oracle.fogbank_batches import render_batches
from tests.oracle.test_oracle import judge

Array = NDArray[np.float64]
FOLDER = REPOSITORY / "scenes" / "analytic"
EXPECTED: dict[str, dict[str, Any]] = tomllib.loads((FOLDER / "expect.toml").read_text())


def integral(function: Callable[[Array], Array], end: float) -> float:
    """Composite Gauss-Legendre over 0 ... end: 64 panels of 32 points."""
    nodes, weights = np.polynomial.legendre.leggauss(32)
    edges = np.linspace(0.0, end, 65)
    half, middle = np.diff(edges)[:, None] / 2, (edges[1:] + edges[:-1])[:, None] / 2
    return float((function((middle + half * nodes).ravel()) * (half * weights).ravel()).sum())


def point_single(sigma_t: float, albedo: float, g: float, end: float) -> float:
    """Radiance along a ray that passes a point light of intensity 10 at distance 1, two units from its start."""

    def along(t: Array) -> Array:
        z = t - 2.0
        distance = np.sqrt(z * z + 1.0)
        # Light travels (0, -1, z) / distance at the scattering point and goes on towards (0, 0, -1).
        cosine = -z / distance
        phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
        return np.asarray(sigma_t * albedo * np.exp(-sigma_t * (t + distance)) * phase * 10.0 / distance**2)

    return integral(along, end)


def area_single(sigma_t: float, albedo: float, end: float) -> float:
    """Radiance along a ray one below a square light of side 1 and radiance 5 that faces it; isotropic."""
    nodes, weights = np.polynomial.legendre.leggauss(32)
    x, y = np.meshgrid(nodes / 2, nodes / 2)
    area = np.outer(weights, weights) / 4

    def along(t: Array) -> Array:
        squared = x**2 + (y - (t[:, None, None] - 2.0)) ** 2 + 1.0
        distance = np.sqrt(squared)
        # radiance x cosine / distance^2, and the cosine is 1 / distance.
        incident = (area * 5.0 * np.exp(-sigma_t * distance) / (distance * squared)).sum((1, 2))
        return np.asarray(sigma_t * albedo * np.exp(-sigma_t * t) / (4 * np.pi) * incident)

    return integral(along, end)


def closed_forms() -> dict[str, Array]:
    sun_sigma_t, sun_albedo = np.array([0.25, 0.5, 2.0]), np.array([0.9, 0.6, 0.3])
    furnace = 1.0 / (1.0 - np.array([0.25, 0.5, 0.75]))
    return {
        "absorbing_slab": np.exp(-2.0 * np.array([0.1, 0.75, 2.0])),
        "furnace_medium": np.ones(3),
        "furnace_medium_chromatic": np.ones(3),
        "furnace_surface": furnace,
        "furnace_surface_medium": furnace,
        "furnace_dielectric_medium": np.ones(3),
        # Beyond 120 units less than exp(-36) is left.
        "point_single": np.full(3, point_single(0.3, 0.8, 0.0, 120.0)),
        "point_single_hg": np.array([point_single(sigma_t, 0.8, 0.7, 14.0) for sigma_t in (0.1, 0.3, 0.9)]),
        "area_single": np.full(3, area_single(0.3, 0.8, 14.0)),
        "sun_slab_single": sun_albedo / np.pi * np.exp(-sun_sigma_t) * (1.0 - np.exp(-2.0 * sun_sigma_t)),
        "lambert_point_absorbing": 0.5 / np.pi * 10.0 / 4.0 * np.exp(-5.0 * np.array([0.02, 0.1, 0.4])),
    }


def test_expected_values_are_those_of_the_formulas() -> None:
    values = closed_forms()
    assert set(values) == set(EXPECTED) == {path.stem for path in FOLDER.glob("*.xml")}
    for name, mean in values.items():
        # The file gives 7 digits or more.
        np.testing.assert_allclose(EXPECTED[name]["mean"], mean, rtol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_render_has_the_expected_value(name: str, service: Service, evidence: Path) -> None:
    mean = np.array(EXPECTED[name]["mean"])
    # The tolerance as a bound of 3 standard errors of a reference that is otherwise exact. It is the same deviation for
    # neighbours, not noise that their mean would lessen: no test of blocks.
    variance = (EXPECTED[name]["relative_tolerance"] * mean / 3.0) ** 2
    pixels = np.ones((16, 16, 1))
    exact = zcheck.Estimate(mean * pixels, variance * pixels, mean, variance, 1_000_000)

    def ours(factor: int, seed: int) -> zcheck.Estimate:
        batches = render_batches(service, FOLDER / f"{name}.xml", spp=64 * factor, batches=16, first_seed=seed)
        return zcheck.estimate(batches)

    judge(f"analytic_{name}", ours, exact, evidence, independent_pixels=False)
