"""The denoiser OIDN, by the package pyoidn."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Denoised:
    """A picture without noise."""

    pixels: npt.NDArray[np.float32]
    """(height, width, 3)."""

    wall_seconds: float
    """Of denoising."""

    cpu_seconds: float
    """The same of all threads."""


def denoise(pixels: npt.NDArray[np.floating]) -> Denoised:
    """Denoises linear radiance (height, width, 3) by its colour alone, which in fog is better than with guides.

    The first call of a process loads the network: don't count it.
    """
    import pyoidn

    noisy = np.ascontiguousarray(pixels, dtype=np.float32)
    begin, cpu_begin = time.perf_counter(), time.process_time()
    clean = np.asarray(pyoidn.denoise(noisy, hdr=True), dtype=np.float32)
    return Denoised(clean, time.perf_counter() - begin, time.process_time() - cpu_begin)
