"""Pictures of the report: tone-mapped images, maps of errors, and the places where methods differ most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image

from fogbank.comparison.image_error import LUMINANCE, Pixels, box_mean, flip, luminance_error
from fogbank.image import to_srgb
from fogbank.window import Window

Colours = npt.NDArray[np.uint8]

_BRIGHT = 0.97
"""Share of the reference's pixels that are not brighter than white."""
_WORST_ERROR = 1.0
_LEAST_ERROR = 1e-3
_INSETS = 3
_INSET_SHARE = 6
"""Of the picture's width."""
_LEAST_INSET = 12
_INSET_SIDE = 210


@dataclass(frozen=True)
class Toning:
    """How radiance becomes colours; the same for all pictures of a report."""

    exposure: float
    """Stops."""

    @classmethod
    def of(cls, reference: Pixels) -> Toning:
        """So that nearly all of the reference is below white."""
        bright = float(np.quantile(reference @ LUMINANCE, _BRIGHT))
        return cls(-float(np.log2(bright)) if bright > 0 else 0.0)

    def colours(self, image: Pixels) -> Colours:
        """8 bits per channel."""
        return to_srgb(image.astype(np.float32), exposure=self.exposure)


def error_map(image: Pixels, reference: Pixels) -> Colours:
    """Relative error of luminance, by its logarithm: black is 0.1 % and less, white 100 % and more."""
    error = np.clip(luminance_error(image, reference), _LEAST_ERROR, _WORST_ERROR)
    return _magma(np.log(error / _LEAST_ERROR) / np.log(_WORST_ERROR / _LEAST_ERROR))


def flip_map(image: Pixels, reference: Pixels) -> Colours:
    """HDR-FLIP: black is no visible difference, white the greatest."""
    found, _ = flip(image, reference)
    return _magma(found)


def choose_insets(images: Sequence[Pixels], reference: Pixels) -> list[Window]:
    """Windows where the pictures of the methods differ most in brightness, without overlap; the worst first."""
    height, width = reference.shape[:2]
    side = min(max(width // _INSET_SHARE, _LEAST_INSET), width, height)
    # Means of 3 x 3 pixels: single noisy pixels don't make a difference worth a look.
    signed = [box_mean((image - reference) @ LUMINANCE, 3) for image in images]
    grey = reference @ LUMINANCE
    spread = np.std(np.stack(signed), axis=0) / (grey + (grey.mean() / 10 or 1.0))
    score = box_mean(np.minimum(spread, _WORST_ERROR), side)
    windows: list[Window] = []
    while len(windows) < _INSETS and score.max() > 0.0:
        y, x = np.unravel_index(int(score.argmax()), score.shape)
        left = int(np.clip(x - side // 2, 0, width - side))
        top = int(np.clip(y - side // 2, 0, height - side))
        windows.append(Window(left, top, side, side))
        score[max(0, top - side // 2) : top + 3 * side // 2, max(0, left - side // 2) : left + 3 * side // 2] = 0.0
    return windows


def crop(colours: Colours, window: Window) -> Colours:
    """The window, its pixels enlarged."""
    part = colours[window.y : window.y + window.height, window.x : window.x + window.width]
    factor = max(1, _INSET_SIDE // max(window.width, window.height))
    return part.repeat(factor, axis=0).repeat(factor, axis=1)


def to_image(colours: Colours) -> Image.Image:
    """For saving."""
    return Image.fromarray(colours)


def _magma(share: npt.NDArray[np.float64]) -> Colours:
    colours: Colours = np.rint(matplotlib.colormaps["magma"](share)[..., :3] * 255.0).astype(np.uint8)
    return colours
