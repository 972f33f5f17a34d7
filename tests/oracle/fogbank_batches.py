"""Fogbank's side of the oracle: independent renders through the Python client."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fogbank import Service


def render_batches(
    service: Service,
    scene_file: Path,
    *,
    spp: int,
    batches: int,
    first_seed: int,
    root: Path | None = None,
    parameters: dict[str, str] | None = None,
    size: tuple[int, int] | None = None,
) -> Iterator[np.ndarray[Any, Any]]:
    """Renders (h, w, 3), float32, linear, that differ in their seed only; each image of the crop window."""
    scene = service.load(scene_file, root=root, parameters=parameters)
    for batch in range(batches):
        job = scene.render(integrator="volpath", spp=spp, seed=first_seed + batch, size=size, pixel_type="float")
        yield np.asarray(job.result())
