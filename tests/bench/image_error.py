"""How wrong a picture is, measured against a reference that is noisy itself.

The reference is kept as two independent halves A and B, and every squared error is the product (X - A)(X - B): the
halves' noise has no part in its expectation. All images are linear RGB, height x width x 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR
from scipy.ndimage import uniform_filter

Pixels = npt.NDArray[np.float64]

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
DENOMINATOR = 1e-2
"""Added to the squared reference, so that black pixels don't decide the relative error."""
TRIMMED = 0.001
"""Share of the pixels, the worst ones, that the trimmed relative error leaves out."""
SOFT_CONTRAST = 0.2
"""Local contrast above which there is a hard edge."""


@dataclass(frozen=True)
class ImageError:
    """Errors of one picture."""

    relative_mse: float
    """Mean over pixels and channels of (X - A)(X - B) / (r^2 + 0.01), r the 5 x 5 mean of the reference."""
    trimmed: float
    """The same without the worst 0.1 % of the pixels."""
    soft: float
    """Share of the reference's soft local contrast that the picture has wrong: 1: as wrong as a flat picture."""
    median: float
    """Of |X - R| / (R + M / 10) of luminances over the pixels, R the mean of A and B, M the mean of R. Not free of the
    reference's noise."""
    percentile_99: float
    """99 % of the pixels have less."""


def read(path: Path) -> Pixels:
    """The channels R, G, B of an EXR file."""
    return np.asarray(OpenEXR.File(str(path)).channels()["RGB"].pixels, dtype=np.float64)


def box_mean(image: Pixels, side: int) -> Pixels:
    """Mean over side x side pixels; beyond the edges the picture is mirrored."""
    size = (side, side) + (1,) * (image.ndim - 2)
    return np.asarray(uniform_filter(image, size=size, mode="reflect"))


def soft_contrast(luminance: Pixels) -> Pixels:
    """What a 3 x 3 mean differs by from a 13 x 13 one."""
    return box_mean(luminance, 3) - box_mean(luminance, 13)


def measure(image: Pixels, half_a: Pixels, half_b: Pixels) -> ImageError:
    """Errors of `image`."""
    reference = (half_a + half_b) / 2
    squared = (image - half_a) * (image - half_b) / (box_mean(reference, 5) ** 2 + DENOMINATOR)
    of_pixel = np.sort(squared.mean(axis=2).ravel())
    kept = of_pixel[: of_pixel.size - round(of_pixel.size * TRIMMED)]

    ours, a, b = (pixels @ LUMINANCE for pixels in (image, half_a, half_b))
    mean = (a + b) / 2
    contrast, contrast_a, contrast_b = (soft_contrast(pixels) for pixels in (ours, a, b))
    soft = np.abs(contrast_a + contrast_b) / 2 < SOFT_CONTRAST * box_mean(mean, 13)
    wrong = float(np.sum(((contrast - contrast_a) * (contrast - contrast_b))[soft]))
    whole = float(np.sum((contrast_a * contrast_b)[soft]))

    relative = np.abs(ours - mean) / (mean + mean.mean() / 10)
    return ImageError(
        relative_mse=float(squared.mean()),
        trimmed=float(kept.mean()),
        soft=float(np.sqrt(max(wrong, 0.0) / whole)) if whole > 0 else 0.0,
        median=float(np.median(relative)),
        percentile_99=float(np.percentile(relative, 99)),
    )
