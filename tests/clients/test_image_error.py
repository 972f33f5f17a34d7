"""The error measures on pictures whose errors are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from fogbank import DataLossError
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


def test_of_absolute_and_symmetric_errors() -> None:
    """0.6 against 0.2: square 0.16, |0.4| / 0.8; two blacks don't differ."""
    reference, image = np.full((16, 16, 3), 0.2), np.full((16, 16, 3), 0.6)
    error = image_error.measure(image, reference, reference)
    assert error.mse == pytest.approx(0.16)
    assert error.smape == pytest.approx(0.5)
    black = np.zeros((16, 16, 3))
    nothing = image_error.measure(black, black, black)
    assert (nothing.mse, nothing.smape, nothing.median, nothing.soft) == (0, 0, 0, 0)


def test_halves_cancel_only_if_independent() -> None:
    """Against the same noisy picture twice its variance, 0.01 / 1.01, counts as error."""
    true = picture(0)
    once = noisy(true, 0.1, 1)
    assert image_error.measure(true, once, once).relative_mse == pytest.approx(0.01 / 1.01, rel=0.05)


def test_split_into_bias_and_variance() -> None:
    """5 % too bright and noise of deviation 0.2, on about 1: 0.0025 and 0.04 by 1.01.

    Bias: 8 pictures leave a scatter of about 2 * 0.05 * sqrt(0.04 / 8) / sqrt(36864) = 4e-5, halves' noise 3e-5.
    """
    true = np.ones((96, 128, 3))
    images = [noisy(1.05 * true, 0.2, seed) for seed in range(8)]
    found = image_error.split(images, noisy(true, 0.1, 100), noisy(true, 0.1, 101))
    assert found.bias_squared == pytest.approx(0.0025 / 1.01, abs=3e-4)
    assert found.variance == pytest.approx(0.04 / 1.01, rel=0.03)
    with pytest.raises(ValueError, match="two seeds"):
        image_error.split(images[:1], true, true)


def test_residual_is_the_noise_of_the_mean() -> None:
    """Halves of variance 0.04: their mean has 0.02."""
    true = np.ones((96, 128, 3))
    found = image_error.residual(noisy(true, 0.2, 1), noisy(true, 0.2, 2))
    assert found == pytest.approx(0.02 / 1.01, rel=0.05)  # trimming takes 1 %


def test_resolution_is_the_scatter_of_a_perfect_picture() -> None:
    """Twice the standard error of 0.04 / 1.01 by the root of 12288 pixels; ours are independent in three channels, so
    that a perfect picture's errors scatter by the root of 3 less.
    """
    true = np.ones((96, 128, 3))
    halves = [noisy(true, 0.2, seed) for seed in range(60)]
    stated = image_error.resolution(halves[0], halves[1])
    assert stated == pytest.approx(2 * 0.04 / 1.01 / np.sqrt(12288), rel=0.1)
    found = [image_error.measure(true, a, b).relative_mse for a, b in zip(halves[::2], halves[1::2], strict=True)]
    assert np.std(found) == pytest.approx(stated / 2 / np.sqrt(3), rel=0.35)  # 30 of them: 13 % standard error


def test_flip_of_equal_and_of_opposite_pictures() -> None:
    """No difference is 0; black for white is the greatest that FLIP knows, up to its edges and exposures."""
    true = picture(0)
    found, mean = image_error.flip(true, true)
    assert found.shape == true.shape[:2]
    assert mean == 0
    _, worst = image_error.flip(np.zeros_like(true), true)
    _, small = image_error.flip(1.02 * true, true)
    assert 0 < small < 0.1 < 0.8 < worst <= 1
    black = np.zeros_like(true)
    assert image_error.flip(black, black)[1] == 0
    assert image_error.flip(true, black)[1] == 1


def test_sizes_must_agree() -> None:
    """Else numpy would stretch or refuse as it likes."""
    with pytest.raises(ValueError, match="different sizes"):
        image_error.measure(np.ones((4, 4, 3)), np.ones((4, 5, 3)), np.ones((4, 5, 3)))


def test_reading_files(tmp_path: Path) -> None:
    """Alpha is passed over; other files are errors that name them."""
    path = tmp_path / "a.exr"
    pixels = np.random.default_rng(1).random((5, 7, 4)).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGBA": pixels}) as file:
        file.write(str(path))
    np.testing.assert_array_equal(image_error.read(path), pixels[:, :, :3])
    path.write_bytes(b"no picture")
    with pytest.raises(DataLossError, match=r"a\.exr"):
        image_error.read(path)
    with OpenEXR.File(header, {"Y": pixels[:, :, 0].copy()}) as file:
        file.write(str(path))
    with pytest.raises(DataLossError, match="no channel R"):
        image_error.read(path)
