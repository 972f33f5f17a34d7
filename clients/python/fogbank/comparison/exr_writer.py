"""Writing of EXR files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR


def write_exr(path: Path, pixels: npt.NDArray[np.floating], attributes: Mapping[str, str] | None = None) -> None:
    """Writes linear radiance (height, width, 3) as 32-bit floats; replaces a file of that name at once or not at all.

    Args:
        path: ends in ".exr".
        pixels: the picture.
        attributes: further attributes of the header.
    """
    header: dict[str, Any] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    unfinished = path.with_name(f".{path.stem}.unfinished.exr")
    channels = {"RGB": np.ascontiguousarray(pixels, dtype=np.float32)}
    with OpenEXR.File({**header, **(attributes or {})}, channels) as file:
        file.write(str(unfinished))
    unfinished.replace(path)
