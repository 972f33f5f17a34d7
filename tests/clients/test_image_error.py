"""The error measures on pictures whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from fogbank.comparison import image_error
from fogbank.comparison.image_error import Pixels


def picture(seed: int) -> Pixels:
    """A smooth pattern."""
    y, x = np.mgrid[0:96, 0:128] / 16
    grey = 1 + 0.05 * np.sin(x * 3 + seed) * np.cos(y * 2)
    return np.repeat(grey[:, :, np.newaxis], 3, axis=2)


def noisy(image: Pixels, deviation: float, seed: int) -> Pixels:
    """With independent noise."""
    return image + np.random.default_rng(seed).normal(0, deviation, image.shape)


def test_of_a_uniform_error() -> None:
    """5 % too bright everywhere: relMSE 0.0025 / (1 + 0.01 / r^2) with r near 1; the pixels differ by 0.05 / 1.1."""
    reference = np.ones((64, 64, 3))
    error = image_error.measure(1.05 * reference, reference, reference)
    assert error.relative_mse == pytest.approx(0.0025 / 1.01)
    assert error.trimmed == pytest.approx(0.0025 / 1.01)
    assert error.median == pytest.approx(0.05 / 1.1)
    assert error.soft == 0


def test_noise_of_the_reference_does_not_count() -> None:
    """Its variance is 100 times what is measured; the product's own scatter is 0.01 / sqrt(36864) = 5e-5."""
    true = picture(0)
    error = image_error.measure(1.01 * true, noisy(true, 0.1, 1), noisy(true, 0.1, 2))
    assert error.relative_mse == pytest.approx(1e-4, abs=2e-4)


def test_noise_of_the_picture_counts() -> None:
    """Variance 0.01 relative to 1.01."""
    true = picture(0)
    error = image_error.measure(noisy(true, 0.1, 3), true, true)
    assert error.relative_mse == pytest.approx(0.01 / 1.01, rel=0.03)


def test_a_flat_picture_has_all_soft_contrast_wrong() -> None:
    """And the right one none of it."""
    true = picture(0)
    assert image_error.measure(np.ones_like(true), true, true).soft == pytest.approx(1, abs=1e-6)
    assert image_error.measure(true, true, true).soft == 0


def test_fireflies_are_trimmed() -> None:
    """12 of 12288 pixels are 0.1 %."""
    true = picture(0)
    image = true.copy()
    image[10:12, 10:16] += 1000
    error = image_error.measure(image, true, true)
    assert error.relative_mse > 100
    assert error.trimmed == pytest.approx(0, abs=1e-12)
