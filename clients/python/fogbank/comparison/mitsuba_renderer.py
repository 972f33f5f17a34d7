"""Mitsuba 3 (the package `mitsuba`): one process per variant, as a variant is set once for all."""

from __future__ import annotations

import importlib
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

LLVM_LIBRARIES = (
    Path("/usr/lib/llvm-19/lib/libLLVM.so.19.1"),
    Path("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"),
)
"""Where Debian puts an LLVM that Mitsuba's just-in-time compiler can use; DRJIT_LIBLLVM_PATH overrides them."""


@dataclass(frozen=True)
class Pass:
    """Some samples of every pixel."""

    pixels: npt.NDArray[np.float32]
    """(height, width, 3)."""

    wall_seconds: float
    """Of rendering, without loading; with compilation where this number of samples is the first of its kind."""

    cpu_seconds: float
    """The same of all threads."""


class MitsubaRenderer:
    """Renders one scene at a time."""

    def __init__(self, variant: str, threads: int | None = None) -> None:
        """Loads Mitsuba; ImportError, AttributeError or ImportError where it or the variant is not there."""
        for library in LLVM_LIBRARIES:
            if library.exists():
                os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))
        # Its stubs are those of another variant than the one that is set here.
        mitsuba: Any = importlib.import_module("mitsuba")
        mitsuba.set_variant(variant)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        drjit: Any = importlib.import_module("drjit")
        if threads is not None:
            drjit.set_thread_count(threads)
        self._mitsuba = mitsuba
        self._scene: Any = None
        self.version: str = mitsuba.__version__

    def load(self, text: str, folder: Path) -> float:
        """Loads a scene from its XML, whose files are below `folder`; wall-clock seconds."""
        self._mitsuba.file_resolver().prepend(str(folder))
        begin = time.perf_counter()
        self._scene = self._mitsuba.load_string(text)
        return time.perf_counter() - begin

    def render(self, samples_per_pixel: int, seed: int, max_depth: int, rr_depth: int) -> Pass:
        """Renders with `volpath`."""
        integrator = self._mitsuba.load_dict({"type": "volpath", "max_depth": max_depth, "rr_depth": rr_depth})
        begin, cpu_begin = time.perf_counter(), time.process_time()
        image = self._mitsuba.render(self._scene, spp=samples_per_pixel, seed=seed, integrator=integrator)
        pixels = np.array(image)[:, :, :3]  # waits for the kernel
        return Pass(pixels, time.perf_counter() - begin, time.process_time() - cpu_begin)
