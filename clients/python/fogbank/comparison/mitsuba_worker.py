"""Renders with Mitsuba 3, perhaps followed by the denoiser OIDN, for a given time.

Samples come in passes of equal size, each rendered at once by a kernel that Mitsuba compiles for this number of
samples. A size is compiled, and its speed measured, before the first picture that uses it; that time is reported apart.
"""

from __future__ import annotations

import importlib.metadata
import math
import time
from pathlib import Path

import numpy as np

from fogbank.comparison.denoise import denoise
from fogbank.comparison.exr_writer import write_exr
from fogbank.comparison.mitsuba_renderer import MitsubaRenderer, Pass
from fogbank.comparison.worker import Render, Rendered, Start, Started, own_peak_bytes

_PASSES = 4
"""At least so many a picture where a sample's time allows it: the last one may end late or early."""
_LANES = 1 << 21
"""Most samples at once; each takes some hundred bytes."""


class MitsubaWorker:
    """See `worker.Worker`."""

    def start(self, start: Start) -> Started:
        """Loads Mitsuba and the scene, and compiles the kernel for single samples."""
        begin = time.perf_counter()
        self._start = start
        self._renderer = MitsubaRenderer(start.settings["variant"], start.threads)
        startup_seconds = time.perf_counter() - begin
        path = Path(start.scene)
        load_seconds = self._renderer.load(path.read_text(encoding="utf-8"), path.parent)
        self._pass_seconds: dict[int, float] = {}
        begin = time.perf_counter()
        self._warm_up(1)
        versions = {"mitsuba": f"{self._renderer.version} {start.settings['variant']}"}
        self._denoise_seconds = 0.0
        if start.settings["denoise"]:
            pixels = self._pass(1, 0).pixels
            denoise(pixels)
            self._denoise_seconds = denoise(pixels).wall_seconds
            versions["pyoidn"] = importlib.metadata.version("pyoidn")
        return Started(startup_seconds, load_seconds, time.perf_counter() - begin, versions)

    def render(self, render: Render) -> Rendered:
        """Renders passes until the time is used, then denoises."""
        if render.seconds is None:
            message = "Mitsuba makes no records"
            raise ValueError(message)
        seconds = max(render.seconds - self._denoise_seconds, 0.0)
        samples = self._choose_samples(seconds)
        warm_up_seconds = self._warm_up(samples)
        total = np.zeros((*reversed(self._start.size), 3))
        wall = cpu = 0.0
        passes = 0
        while passes == 0 or wall + self._pass_seconds[samples] / 2 < seconds:
            done = self._pass(samples, (render.seed << 16) + passes + 1)
            total += done.pixels
            wall += done.wall_seconds
            cpu += done.cpu_seconds
            passes += 1
            self._pass_seconds[samples] = wall / passes
        pixels = (total / passes).astype(np.float32)
        denoise_seconds = 0.0
        if self._start.settings["denoise"]:
            denoised = denoise(pixels)
            pixels, denoise_seconds = denoised.pixels, denoised.wall_seconds
            wall += denoised.wall_seconds
            cpu += denoised.cpu_seconds
        write_exr(Path(render.output), pixels)
        return Rendered(
            wall_seconds=wall,
            cpu_seconds=cpu,
            denoise_seconds=denoise_seconds,
            warm_up_seconds=warm_up_seconds,
            samples_per_pixel=passes * samples,
            peak_bytes=own_peak_bytes(),
        )

    def _choose_samples(self, seconds: float) -> int:
        """A power of two, of which several passes fit into this time."""
        known = max(self._pass_seconds)
        rate = self._pass_seconds[known] / known
        pixels = self._start.size[0] * self._start.size[1]
        most = min(seconds / (_PASSES * rate), _LANES / pixels)
        return 1 << max(0, math.floor(math.log2(max(most, 1.0))))

    def _warm_up(self, samples: int) -> float:
        """Compiles the kernel for passes of this size unless that was done; wall-clock seconds."""
        if samples in self._pass_seconds:
            return 0.0
        first = self._pass(samples, 0)
        self._pass_seconds[samples] = self._pass(samples, 0).wall_seconds
        return first.wall_seconds + self._pass_seconds[samples]

    def _pass(self, samples: int, seed: int) -> Pass:
        return self._renderer.render(samples, seed % (1 << 32), self._start.max_depth, self._start.mitsuba_rr_depth)
