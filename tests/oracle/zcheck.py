"""Do two renderers draw the same picture? Statistics on images whose noise is known.

An `Estimate` is the mean of independent batches (renders that differ in their seed only) with that mean's variance.
`compare` puts three questions to two of them, each at a family-wise level of 1 %:

1. Pixels. Per pixel and channel, Welch's t-test of equal means. With n batches the variance is itself an estimate, so
   the statistic follows Student's t with n - 1 degrees of freedom or a few more, not the normal law: at the level that
   one pixel gets after Sidak's correction (3e-6 for 32 x 32 x 3) t with 15 degrees of freedom reaches 7, a normal z but
   4.6. Reading it as z would reject correct pictures. At least 99.75 % of the pixel-channels have to pass.
   Path tracing is heavy-tailed: a pixel whose few samples all missed a rare bright path is too dark and, by the same
   accident, too sure of it. Its neighbours know better, therefore a pixel's variance is at least the mean over its
   3 x 3 neighbourhood. That errs towards passing; the next two tests make up for it.
2. Blocks of 8 x 8 pixels, the same test on their means: finds an object that is wrong by a little everywhere. Needs
   pixels that are independent of each other, i.e. the box filter; left out for others.
3. The whole image, per channel: the means differ by at most 3 standard errors, or rather by what Student's t of the
   batches' image means has at the same probability of 0.27 %. Batch means see the correlation that reconstruction
   filters put between pixels; a sum over pixel variances would not.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy import stats

Array = NDArray[np.float64]

FAMILY_LEVEL = 0.01
PASSING_SHARE = 0.9975
THREE_SIGMA_LEVEL = 2.0 * float(stats.norm.sf(3.0))
BLOCK = 8
# Relative rounding of a mean of float32 renders; keeps noise-free pixels (an emitter in view) from dividing by 0.
ROUNDING = 3e-6


@dataclass(frozen=True)
class Estimate:
    """mean, variance: (h, w, 3), the variance is that of the mean; image_*: (3,) likewise; batches: how many."""

    mean: Array
    variance: Array
    image_mean: Array
    image_variance: Array
    batches: int


def estimate(batches: Iterable[ArrayLike]) -> Estimate:
    """From two or more independent renders of equal sample count, (h, w, 3) each. Raises ValueError for fewer, for
    images of other shapes and for values that are not finite."""
    count = 0
    mean = squares = image_mean = image_squares = np.zeros(0)
    for batch in batches:
        image = np.asarray(batch, dtype=np.float64)
        if image.ndim != 3 or image.shape[2] != 3 or (count > 0 and image.shape != mean.shape):
            raise ValueError(f"batch {count} has shape {image.shape}, not (h, w, 3) like the others")
        if not np.all(np.isfinite(image)):
            raise ValueError(f"batch {count} has {int((~np.isfinite(image)).sum())} values that are not finite")
        if count == 0:
            mean, squares = np.zeros_like(image), np.zeros_like(image)
            image_mean, image_squares = np.zeros(3), np.zeros(3)
        count += 1
        # Welford's update: sums of squares would cancel where noise is small.
        step = image - mean
        mean = mean + step / count
        squares = squares + step * (image - mean)
        average = image.mean((0, 1))
        image_step = average - image_mean
        image_mean = image_mean + image_step / count
        image_squares = image_squares + image_step * (average - image_mean)
    if count < 2:
        raise ValueError(f"{count} batches have no variance; give at least 2, better 16")
    scale = 1.0 / ((count - 1) * count)
    return Estimate(mean, squares * scale, image_mean, image_squares * scale, count)


def estimate_from_halves(mean: ArrayLike, first: ArrayLike, second: ArrayLike) -> Estimate:
    """From the mean of all samples and the means of two halves of them, when nothing else was kept.

    Two halves give a variance with one degree of freedom, useless by itself; averaged over 5 x 5 pixels it has some 25.
    Where noise changes fast it smears, so this suits references with far less noise than what they are compared to.
    """
    middle, a, b = (np.asarray(image, dtype=np.float64) for image in (mean, first, second))
    variance = _box_mean((a - b) ** 2 / 4.0, 2)
    image_step = a.mean((0, 1)) - b.mean((0, 1))
    # The image mean's variance from the pixels, not from its own two halves: one degree of freedom would be too few.
    pixel_variance = ((a - b) ** 2 / 4.0).sum((0, 1)) / (a.shape[0] * a.shape[1]) ** 2
    return Estimate(middle, variance, middle.mean((0, 1)), np.maximum(pixel_variance, image_step**2 / 16.0), 26)


@dataclass(frozen=True)
class Comparison:
    """Outcome of `compare`: z holds each pixel-channel's difference in equivalent normal standard errors (h, w, 3)."""

    failures: tuple[str, ...]
    z: Array
    passing_share: float
    image_difference: Array
    image_standard_error: Array
    ours: Estimate
    reference: Estimate

    @property
    def passed(self) -> bool:
        return not self.failures

    def report(self) -> str:
        """Figures, failures and the five worst pixels."""
        lines = [
            f"pixel-channels that pass: {100.0 * self.passing_share:.3f} %, rms z {np.sqrt((self.z**2).mean()):.2f}",
            f"image mean: ours {_numbers(self.ours.image_mean)}, reference {_numbers(self.reference.image_mean)}, "
            f"difference {_numbers(self.image_difference / self.image_standard_error)} standard errors",
            *self.failures,
        ]
        if self.failures:
            order = np.argsort(-np.abs(self.z), axis=None)[:5]
            for y, x, channel in zip(*np.unravel_index(order, self.z.shape), strict=True):
                lines.append(
                    f"pixel x {x} y {y} {'RGB'[channel]}: ours {self.ours.mean[y, x, channel]:.6g}, reference "
                    f"{self.reference.mean[y, x, channel]:.6g}, z {self.z[y, x, channel]:+.1f}"
                )
        return "\n".join(lines)

    def save(self, folder: Path, name: str) -> None:
        """Writes NAME_ours.exr, NAME_reference.exr, NAME_z.exr and NAME_z.png (red: ours is brighter, blue: darker; of
        the channel that differs most, full colour at 6 standard errors)."""
        folder.mkdir(parents=True, exist_ok=True)
        for suffix, pixels in (("ours", self.ours.mean), ("reference", self.reference.mean), ("z", self.z)):
            write_exr(folder / f"{name}_{suffix}.exr", {"RGB": pixels})
        worst = np.take_along_axis(self.z, np.abs(self.z).argmax(2)[..., None], 2)[..., 0]
        strength = np.clip(np.abs(worst) / 6.0, 0.0, 1.0)
        fade = 1.0 - strength
        picture = np.stack([np.where(worst > 0, 1.0, fade), fade, np.where(worst > 0, fade, 1.0)], -1)
        Image.fromarray(np.round(255.0 * picture).astype(np.uint8)).save(folder / f"{name}_z.png")


def compare(ours: Estimate, reference: Estimate, *, independent_pixels: bool = True) -> Comparison:
    """Raises ValueError for images of different sizes; see the module for the tests."""
    if ours.mean.shape != reference.mean.shape:
        raise ValueError(f"ours is {ours.mean.shape}, the reference {reference.mean.shape}")
    failures = []

    z = _welch_z(ours.mean, _floored(ours), ours.batches, reference.mean, _floored(reference), reference.batches)
    limit = _two_sided_limit(z.size)
    share = float((np.abs(z) <= limit).mean())
    if share < PASSING_SHARE:
        failures.append(
            f"PIXELS: {100.0 * share:.3f} % are within {limit:.2f} standard errors, not {PASSING_SHARE:.2%}"
        )

    if independent_pixels:
        # A block's pooled variance has many times the degrees of freedom of a pixel's; counting only the pixel's errs
        # towards passing.
        blocks = _welch_z(_blocks(ours.mean, 1), _blocks(ours.variance, 2), ours.batches,
                          _blocks(reference.mean, 1), _blocks(reference.variance, 2), reference.batches)  # fmt: skip
        block_limit = _two_sided_limit(blocks.size)
        if np.abs(blocks).max() > block_limit:
            row, column, channel = np.unravel_index(int(np.abs(blocks).argmax()), blocks.shape)
            failures.append(
                f"BLOCKS: the {BLOCK} x {BLOCK} block at x {BLOCK * column} y {BLOCK * row} {'RGB'[channel]} is "
                f"{blocks[row, column, channel]:+.1f} standard errors off, limit {block_limit:.2f}"
            )

    image_z = _welch_z(ours.image_mean, ours.image_variance, ours.batches,
                       reference.image_mean, reference.image_variance, reference.batches)  # fmt: skip
    if np.abs(image_z).max() > 3.0:
        failures.append(f"IMAGE: the means differ by {_numbers(image_z)} standard errors (equivalent), limit 3")
    difference = ours.image_mean - reference.image_mean
    error = np.sqrt(ours.image_variance + reference.image_variance + (ROUNDING * reference.image_mean) ** 2 + 1e-30)
    return Comparison(tuple(failures), z, share, difference, error, ours, reference)


def write_exr(path: Path, channels: dict[str, Array], attributes: dict[str, str] | None = None) -> None:
    """float32, ZIP; a key such as "RGB" takes (h, w, 3)."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(attributes or {})}
    pixels = {name: np.ascontiguousarray(values.astype(np.float32)) for name, values in channels.items()}
    OpenEXR.File(header, pixels).write(str(path))


def _two_sided_limit(tests: int) -> float:
    """Standard errors that a correct image exceeds in any of `tests` comparisons with FAMILY_LEVEL (Sidak)."""
    single = -np.expm1(np.log1p(-FAMILY_LEVEL) / tests)
    return float(stats.norm.isf(single / 2.0))


def _welch_z(mean_a: Array, variance_a: Array, count_a: int, mean_b: Array, variance_b: Array, count_b: int) -> Array:
    """Welch's t with its degrees of freedom, mapped to the normal z of the same two-sided probability."""
    rounding = (ROUNDING * np.maximum(np.abs(mean_a), np.abs(mean_b))) ** 2 + 1e-30
    variance = variance_a + variance_b + rounding
    freedom = variance**2 / (variance_a**2 / (count_a - 1) + variance_b**2 / (count_b - 1) + 1e-6 * rounding**2)
    t = (mean_a - mean_b) / np.sqrt(variance)
    # In logarithms: the tail probabilities of a wrong picture underflow.
    log_tail = stats.t.logsf(np.abs(t), freedom)
    z = -stats.norm.ppf(np.exp(np.maximum(log_tail, -700.0)))
    return np.asarray(np.sign(t) * z)


def _floored(estimate_: Estimate) -> Array:
    return np.maximum(estimate_.variance, _box_mean(estimate_.variance, 1))


def _box_mean(image: Array, radius: int) -> Array:
    """Mean over the (2 radius + 1)^2 neighbourhood, edges repeated."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((radius, radius), (radius, radius), (0, 0)), mode="edge")
    side = 2 * radius + 1
    parts = [padded[y : y + height, x : x + width] for y in range(side) for x in range(side)]
    return np.asarray(np.mean(parts, axis=0))


def _blocks(image: Array, power: int) -> Array:
    """Sums over blocks divided by (pixels of the block)^power: 1 gives means, 2 their variance from pixel variances."""
    rows = np.arange(0, image.shape[0], BLOCK)
    columns = np.arange(0, image.shape[1], BLOCK)
    total = np.add.reduceat(np.add.reduceat(image, rows, 0), columns, 1)
    heights = np.diff(np.append(rows, image.shape[0]))
    widths = np.diff(np.append(columns, image.shape[1]))
    area = (heights[:, None] * widths[None, :]).astype(np.float64)[..., None]
    return np.asarray(total / area**power)


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:.5g}" for value in values)
