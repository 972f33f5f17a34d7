"""How wrong a picture is, measured against a reference that is noisy itself.

The reference is kept as two independent halves A and B, and every squared error is the product (X - A)(X - B): the
halves' noise has no part in its expectation. Measures that are not squares (SMAPE, FLIP, median, percentile) are taken
against the mean of A and B and contain its noise. All images are linear Rec. 709, float64, height x width x 3.

Needs the extra `compare` of the package (scipy, flip-evaluator).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR
from scipy.ndimage import uniform_filter

from fogbank.errors import DataLossError

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

    mse: float
    """Mean over pixels and channels of (X - A)(X - B), in the scene's radiance squared."""
    relative_mse: float
    """Mean over pixels and channels of (X - A)(X - B) / (r^2 + 0.01), r the 5 x 5 mean of the reference."""
    trimmed: float
    """The same without the worst 0.1 % of the pixels."""
    soft: float
    """Share of the reference's soft local contrast that the picture has wrong: 1: as wrong as a flat picture."""
    smape: float
    """Mean over pixels and channels of |X - R| / (|X| + |R|), 0 to 1; R the mean of A and B."""
    median: float
    """Of |X - R| / (R + M / 10) of luminances over the pixels, M the mean of R."""
    percentile_99: float
    """99 % of the pixels have less."""


@dataclass(frozen=True)
class BiasVariance:
    """What repeated seeds of one setting say about the error of one picture, relative as `ImageError.relative_mse`."""

    bias_squared: float
    """Error that no number of seeds would average out. An estimate without bias of its own: it may be below 0."""
    variance: float
    """Scatter of a single picture about the mean of all."""


def read(path: Path) -> Pixels:
    """The channels R, G, B of an EXR file; DataLossError, naming it, when there are none."""
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
            return np.stack([channels[name] for name in "RGB"], axis=2).astype(np.float64)
    except KeyError as error:
        raise DataLossError(f"{path} has no channel {error.args[0]}; R, G, B expected") from None
    except (RuntimeError, ValueError) as error:
        raise DataLossError(f"{path}: {error}") from None


def box_mean(image: Pixels, side: int) -> Pixels:
    """Mean over side x side pixels; beyond the edges the picture is mirrored."""
    size = (side, side) + (1,) * (image.ndim - 2)
    return np.asarray(uniform_filter(image, size=size, mode="reflect"))


def soft_contrast(luminance: Pixels) -> Pixels:
    """What a 3 x 3 mean differs by from a 13 x 13 one."""
    return box_mean(luminance, 3) - box_mean(luminance, 13)


def relative_weight(reference: Pixels) -> Pixels:
    """What makes a squared error relative: 1 / (r^2 + 0.01), r the 5 x 5 mean of the reference."""
    return np.asarray(1.0 / (box_mean(reference, 5) ** 2 + DENOMINATOR))


def trimmed_mean(squared: Pixels) -> float:
    """Mean of errors (height, width, 3) without those of the worst 0.1 % of the pixels."""
    of_pixel = np.sort(squared.mean(axis=2).ravel())
    return float(of_pixel[: of_pixel.size - round(of_pixel.size * TRIMMED)].mean())


def luminance_error(image: Pixels, reference: Pixels) -> Pixels:
    """|X - R| / (R + M / 10) of luminances, (height, width); M the mean of R, and 1 for a black reference."""
    ours, mean = image @ LUMINANCE, reference @ LUMINANCE
    return np.asarray(np.abs(ours - mean) / (mean + (mean.mean() / 10 or 1.0)))


def smape_map(image: Pixels, reference: Pixels) -> Pixels:
    """|X - R| / (|X| + |R|), 0 where both are 0."""
    size = np.abs(image) + np.abs(reference)
    return np.asarray(np.divide(np.abs(image - reference), size, out=np.zeros_like(size), where=size > 0))


def measure(image: Pixels, half_a: Pixels, half_b: Pixels) -> ImageError:
    """Errors of `image`; ValueError for images of different sizes."""
    if not image.shape == half_a.shape == half_b.shape:
        message = f"images of different sizes: {image.shape}, reference {half_a.shape} and {half_b.shape}"
        raise ValueError(message)
    reference = (half_a + half_b) / 2
    square = (image - half_a) * (image - half_b)
    relative = square * relative_weight(reference)

    ours, a, b = (pixels @ LUMINANCE for pixels in (image, half_a, half_b))
    mean = (a + b) / 2
    contrast, contrast_a, contrast_b = (soft_contrast(pixels) for pixels in (ours, a, b))
    soft = np.abs(contrast_a + contrast_b) / 2 < SOFT_CONTRAST * box_mean(mean, 13)
    wrong = float(np.sum(((contrast - contrast_a) * (contrast - contrast_b))[soft]))
    whole = float(np.sum((contrast_a * contrast_b)[soft]))

    of_luminance = luminance_error(image, reference)
    return ImageError(
        mse=float(square.mean()),
        relative_mse=float(relative.mean()),
        trimmed=trimmed_mean(relative),
        soft=float(np.sqrt(max(wrong, 0.0) / whole)) if whole > 0 else 0.0,
        smape=float(smape_map(image, reference).mean()),
        median=float(np.median(of_luminance)),
        percentile_99=float(np.percentile(of_luminance, 99)),
    )


def split(images: Sequence[Pixels], half_a: Pixels, half_b: Pixels) -> BiasVariance:
    """Bias and variance of pictures of one setting with different seeds; ValueError for less than two.

    With m the mean of n pictures and s^2 their variance (n - 1 in its denominator), E[(m - A)(m - B)] is
    bias^2 + s^2 / n.
    """
    if len(images) < 2:
        message = "bias and variance need pictures of two seeds at least"
        raise ValueError(message)
    stack = np.stack(images)
    mean, scatter = stack.mean(axis=0), stack.var(axis=0, ddof=1)
    weight = relative_weight((half_a + half_b) / 2)
    bias = (mean - half_a) * (mean - half_b) - scatter / len(images)
    return BiasVariance(bias_squared=float((bias * weight).mean()), variance=float((scatter * weight).mean()))


def residual(half_a: Pixels, half_b: Pixels) -> float:
    """Relative MSE that noise leaves in the mean of two independent halves, the worst 0.1 % of the pixels left out.

    The variance of (A + B) / 2 is E[(A - B)^2] / 4.
    """
    return trimmed_mean((half_a - half_b) ** 2 / 4 * relative_weight((half_a + half_b) / 2))


def resolution(half_a: Pixels, half_b: Pixels) -> float:
    """Relative MSE below which a reference can't tell pictures from the truth: twice the standard error of
    `ImageError.trimmed` of a perfect picture.

    Of noise with variance s^2 in each half the product of its errors has variance s^4, and with normal noise
    E[((A - B)^2 / 2)^2] is 3 s^4. A pixel's channels count as one sample: their noise often is the same.
    """
    fourth = ((half_a - half_b) ** 2 / 2 * relative_weight((half_a + half_b) / 2)) ** 2 / 3
    return 2.0 * float(np.sqrt(trimmed_mean(fourth) / (fourth.shape[0] * fourth.shape[1])))


def flip(image: Pixels, reference: Pixels) -> tuple[Pixels, float]:
    """HDR-FLIP of Andersson et al. 2021, by flip-evaluator with its default viewing distance (67 pixels a degree).

    Returns the map (height, width), 0 to 1, and its mean. Exposures follow from the reference; a reference without
    light has none, and anything but a black picture is then wholly wrong.
    """
    import flip_evaluator

    if reference.max() <= 0.0:
        wrong = (image.max(axis=2) > 0.0).astype(np.float64)
        return wrong, float(wrong.mean())
    found, _, _ = flip_evaluator.evaluate(
        np.maximum(reference, 0.0).astype(np.float32),
        np.maximum(image, 0.0).astype(np.float32),
        "HDR",
        applyMagma=False,
    )
    error_map = np.asarray(found, dtype=np.float64).reshape(image.shape[:2])
    return error_map, float(error_map.mean())
