"""Finished images."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from PIL import Image as PillowImage
from PIL.PngImagePlugin import PngInfo

from fogbank import exr
from fogbank.atomic_file import write_atomically
from fogbank.errors import DataLossError
from fogbank.pixels import PixelArray


class Image(PixelArray):
    """A finished image: read-only float32 array of linear Rec. 709 radiance, shape (height, width, 3).

    Attributes:
        window: the part of the film that it covers; the whole film unless the job had a crop window.
        film_size: width and height of the whole film in pixels.
        variance: estimated variance of each value, same shape; None unless the job was told to bring it.
        aovs: what the cache says about each pixel, by name ("radius", "record-density", "rejected", "variance",
            "bias"), float32 arrays of shape (height, width); those that the job was told to bring.
        metadata: the provenance in the file's header: scene fingerprint, settings, seed, samples, version...
        exr: the server's EXR file, byte for byte.
    """

    film_size: tuple[int, int]
    variance: npt.NDArray[np.float32] | None
    aovs: dict[str, npt.NDArray[np.float32]]
    metadata: dict[str, Any]
    exr: bytes

    @classmethod
    def from_exr(cls, data: bytes, *, sha256: str | None = None) -> Self:
        """Decodes an EXR file; DataLossError when it is damaged or its SHA-256 (hexadecimal) is another."""
        if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
            raise DataLossError(f"the downloaded image does not have the SHA-256 {sha256}")
        decoded = exr.decode(data)
        image = decoded.pixels.view(cls)
        image.window = decoded.window
        image.film_size = decoded.film_size
        image.variance = decoded.variance
        image.aovs = decoded.aovs
        image.metadata = decoded.metadata
        image.exr = data
        image.flags.writeable = False
        if image.variance is not None:
            image.variance.flags.writeable = False
        for values in image.aovs.values():
            values.flags.writeable = False
        return image

    def save(self, path: str | os.PathLike[str], *, exposure: float = 0.0) -> None:
        """Writes the image; a file of that name is replaced at once or not at all.

        Args:
            path: ends in ".exr" for the server's file as it is, with its provenance, or in ".png" for 8 bits per
                channel by the sRGB tone curve (see `to_srgb`), values over 1 clipped.
            exposure: stops, for PNG only: radiance is multiplied by 2**exposure first.
        """
        path = Path(path)
        check_image_path(path)
        if path.suffix.lower() == ".exr":
            write_atomically(path, lambda file: file.write(self.exr))
            return
        png_info = PngInfo()
        # Chunk sRGB, rendering intent 0 (perceptual): tells viewers which curve was used.
        png_info.add(b"sRGB", b"\x00")
        picture = PillowImage.fromarray(to_srgb(self, exposure=exposure))
        write_atomically(path, lambda file: picture.save(file, format="PNG", pnginfo=png_info))


def check_image_path(path: Path) -> None:
    """ValueError unless `Image.save` knows the format that the name asks for."""
    if path.suffix.lower() not in (".exr", ".png"):
        raise ValueError(f"{path}: cannot write this format; the name must end in .exr or .png")


def to_srgb(radiance: npt.NDArray[np.float32], *, exposure: float = 0.0) -> npt.NDArray[np.uint8]:
    """Display values 0 to 255 by the sRGB tone curve of IEC 61966-2-1 (linear below 0.0031308, then power 1/2.4).

    Args:
        radiance: linear Rec. 709, any shape; clipped to 0...1 after the exposure.
        exposure: stops; radiance is multiplied by 2**exposure.
    """
    linear = np.clip(np.asarray(radiance, dtype=np.float32) * np.float32(2.0**exposure), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    display: npt.NDArray[np.uint8] = np.rint(encoded * 255.0).astype(np.uint8)
    return display
