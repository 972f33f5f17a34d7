"""References for pictures by the radiance cache, in two independent halves: their noise has no part in an error then.

    python -m tests.oracle.cache_references [NAME ...]      from the root of the repository; some minutes

Rendered by Fogbank's volpath, which test_oracle.py holds against Mitsuba. A file has the means of the halves (a.R, ...,
b.R, ...), float32, and in its header as JSON: samples, camera, and the SHA-256 of the scene with all its files.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fogbank
import numpy as np
import OpenEXR
from fogbank import Service
from numpy.typing import NDArray

from tests.oracle import zcheck
from tests.oracle.cases import REPOSITORY, Case, scene_digest

FOLDER = Path(__file__).resolve().parent / "cache_references"
ATTRIBUTE = "reference"
SEEDS = (1, 2)
SIDE = 32

Pixels = NDArray[np.float64]


@dataclass(frozen=True)
class CacheCase:
    """A scene of scenes/ from one camera, SIDE x SIDE pixels.

    Attributes:
        name: unique; also the reference's file name.
        scene: folder and file of scenes/.
        spp: samples per pixel of each half.
        camera: as clients/README.md says; None for the scene's own.
    """

    name: str
    scene: str
    spp: int
    camera: dict[str, Any] | None = None

    @property
    def reference(self) -> Path:
        return FOLDER / f"{self.name}.exr"

    @property
    def scene_file(self) -> Path:
        return REPOSITORY / "scenes" / self.scene / f"{self.scene}.xml"

    def digest(self) -> str:
        """SHA-256 of the scene with all its files."""
        return scene_digest(Case(self.name, self.scene_file, self.scene_file.parent))


# The error of a half is at most about the error asked for, so that 1024 pixels tell errors apart that differ by 5 %.
STILLS = [
    CacheCase("penumbra", "penumbra", 1024),
    CacheCase("shafts", "shafts", 2048),
    CacheCase("glow", "glow", 2048),
    CacheCase("stairs", "stairs", 4096),
]


def _beside(shift: float) -> dict[str, Any]:
    """The camera of penumbra.xml, moved to the right by `shift`."""
    return {"origin": [shift, -3, 0.5], "target": [shift, 0, 0.5], "up": [0, 0, 1], "fov": 73.7398}


# 0.05 a frame: about a third of a pixel at the plates' distance.
SWEEP = [CacheCase(f"penumbra_sweep_{frame}", "penumbra", 1024, _beside(0.05 * (frame - 2))) for frame in range(5)]


def all_cases() -> list[CacheCase]:
    """Every case that has a reference."""
    return STILLS + SWEEP


def store(case: CacheCase, service: Service) -> None:
    """Renders both halves and writes case.reference."""
    scene = service.load(case.scene_file)
    channels: dict[str, Pixels] = {}
    for half, seed in zip("ab", SEEDS, strict=True):
        job = scene.render(
            integrator="volpath", spp=case.spp, seed=seed, size=(SIDE, SIDE), camera=case.camera, pixel_type="float"
        )
        pixels = np.asarray(job.result(), dtype=np.float64)
        channels |= {f"{half}.{'RGB'[k]}": pixels[..., k] for k in range(3)}
    about = {"samples_per_pixel": case.spp, "seeds": SEEDS, "camera": case.camera, "scene_sha256": case.digest()}
    FOLDER.mkdir(exist_ok=True)
    zcheck.write_exr(case.reference, channels, {ATTRIBUTE: json.dumps(about, sort_keys=True)})


def load(case: CacheCase) -> tuple[Pixels, Pixels]:
    """The halves (h, w, 3). Raises ValueError if scene or camera have changed since."""
    file = OpenEXR.File(str(case.reference), separate_channels=True)
    about = json.loads(file.header()[ATTRIBUTE])
    if about["scene_sha256"] != case.digest() or about["camera"] != case.camera:
        raise ValueError(f"{case.name} has changed since; run: python -m tests.oracle.cache_references {case.name}")
    channels = file.channels()

    def pixels(half: str) -> Pixels:
        return np.stack([channels[f"{half}.{name}"].pixels for name in "RGB"], -1).astype(np.float64)

    return pixels("a"), pixels("b")


def main() -> None:
    """Renders those that are named, or all."""
    wanted = sys.argv[1:] or [case.name for case in all_cases()]
    unknown = set(wanted) - {case.name for case in all_cases()}
    if unknown:
        sys.exit(f"no case {', '.join(sorted(unknown))}; there are: {', '.join(case.name for case in all_cases())}")
    with fogbank.connect() as service:
        for case in all_cases():
            if case.name in wanted:
                store(case, service)
                print(f"{case.name}: {case.reference}")


if __name__ == "__main__":
    main()
