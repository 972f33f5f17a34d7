"""Decoding of the EXR files that the server sends."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR

from fogbank.errors import DataLossError
from fogbank.window import Window

# Header attributes that say how the file is stored; the others are its provenance.
_STORAGE_ATTRIBUTES = frozenset(
    {
        "channels",
        "chunkCount",
        "compression",
        "dataWindow",
        "displayWindow",
        "lineOrder",
        "name",
        "pixelAspectRatio",
        "screenWindowCenter",
        "screenWindowWidth",
        "tiles",
        "type",
        "version",
    }
)

_AOV_PREFIX = "cache."


@dataclass(frozen=True)
class DecodedExr:
    """What an EXR file holds."""

    pixels: npt.NDArray[np.float32]
    """Linear Rec. 709 radiance, shape (height, width, 3)."""

    variance: npt.NDArray[np.float32] | None
    """Variance of each value of `pixels`, same shape; None when the file has none."""

    aovs: dict[str, npt.NDArray[np.float32]]
    """What the cache says about each pixel, shape (height, width), by name; empty when the file has none."""

    window: Window
    """The film window that `pixels` covers (the file's data window)."""

    film_size: tuple[int, int]
    """Width and height of the whole film (the file's display window)."""

    metadata: dict[str, Any]
    """Every header attribute that is not about storage, such as scene fingerprint, settings and seed."""


def decode(data: bytes) -> DecodedExr:
    """Reads a one-part EXR file with channels R, G, B; DataLossError when it is damaged or has no such channels."""
    try:
        with OpenEXR.File(io.BytesIO(data)) as file:
            header = dict(file.header())
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise DataLossError(f"damaged EXR data ({len(data)} bytes): {error}") from None
    window = _window(header["dataWindow"])
    film = _window(header["displayWindow"])
    variance = channels.get("variance")
    return DecodedExr(
        pixels=_rgb(channels.get("RGB"), window),
        variance=None if variance is None else _rgb(variance, window),
        aovs={
            name.removeprefix(_AOV_PREFIX): np.ascontiguousarray(values, dtype=np.float32)
            for name, values in channels.items()
            if name.startswith(_AOV_PREFIX)
        },
        window=window,
        film_size=(film.width, film.height),
        metadata={name: value for name, value in header.items() if name not in _STORAGE_ATTRIBUTES},
    )


def _rgb(pixels: npt.NDArray[Any] | None, window: Window) -> npt.NDArray[np.float32]:
    expected = (window.height, window.width, 3)
    if pixels is None or pixels.shape != expected:
        found = "none" if pixels is None else f"shape {pixels.shape}"
        raise DataLossError(f"EXR data with channels R, G, B of shape {expected} expected; found {found}")
    return np.ascontiguousarray(pixels, dtype=np.float32)


def _window(box: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]) -> Window:
    """EXR boxes include their last row and column."""
    (x0, y0), (x1, y1) = box[0].tolist(), box[1].tolist()
    return Window(x0, y0, x1 - x0 + 1, y1 - y0 + 1)
