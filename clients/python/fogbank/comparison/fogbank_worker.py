"""Renders with an integrator of Fogbank, by a server of its own; every picture begins with an empty cache."""

from __future__ import annotations

import re
import tempfile
import time
from pathlib import Path
from typing import Any

import fogbank
from fogbank.cache_picture import draw
from fogbank.comparison.worker import Render, Rendered, Start, Started

_PICTURE_SIDE = 900


class FogbankWorker:
    """See `worker.Worker`."""

    def start(self, start: Start) -> Started:
        """Starts a server with an empty data directory and loads the scene."""
        self._folder = tempfile.TemporaryDirectory(prefix="fogbank-comparison-")
        begin = time.perf_counter()
        self._service = fogbank.connect(data=self._folder.name, threads=start.threads)
        startup_seconds = time.perf_counter() - begin
        self._scene = self._service.load(start.scene)
        self._options: fogbank.RenderOptions = {
            "size": start.size,
            "max_depth": start.max_depth,
            "pixel_type": "float",
            **start.settings,  # type: ignore[typeddict-item]
        }
        capabilities = self._service.capabilities
        self._cached = start.settings["integrator"] in capabilities.cached_integrators
        return Started(
            startup_seconds=startup_seconds,
            load_seconds=self._scene.load_seconds,
            warm_up_seconds=0.0,
            versions={"fogbank": f"{capabilities.version} ({capabilities.build_id[:12]})"},
        )

    def render(self, render: Render) -> Rendered:
        """Renders with an empty cache."""
        if self._cached:
            self._empty_cache()
        options = self._options | fogbank.RenderOptions(
            time_budget=render.seconds, records=render.records, spp=render.spp, seed=render.seed
        )
        job = self._scene.render(**options)
        job.result().save(render.output)
        statistics = job.statistics
        if statistics is None:
            raise fogbank.InternalError(f"{job.name} succeeded and has no result")
        if statistics.records_reused:
            raise fogbank.InternalError(f"{statistics.records_reused} records were there before a cold render")
        note = f"{statistics.invalid_samples} invalid samples" if statistics.invalid_samples else ""
        more: dict[str, Any] = {}
        if self._cached:
            more = {"estimated_error": statistics.estimated_error, "noise": statistics.noise, "bias": statistics.bias}
            if render.cache_picture:
                view = self._scene.cache.view(side=_PICTURE_SIDE, **self._options)
                draw(view).save(render.cache_picture)
        return Rendered(
            wall_seconds=statistics.render_seconds,
            cpu_seconds=statistics.render_cpu_seconds,
            samples_per_pixel=statistics.samples_per_pixel,
            rays=statistics.rays,
            records=statistics.records_new if self._cached else None,
            peak_bytes=self._peak_bytes(),
            note=note,
            more=more,
        )

    def _empty_cache(self) -> None:
        for cache in self._service.caches():
            cache.delete()

    def _peak_bytes(self) -> int | None:
        if self._service.server_process_id is None:
            return None
        status = Path(f"/proc/{self._service.server_process_id}/status").read_text(encoding="utf-8")
        found = re.search(r"VmHWM:\s*(\d+) kB", status)
        return int(found[1]) * 1024 if found else None
