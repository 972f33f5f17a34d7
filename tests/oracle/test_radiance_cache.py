"""Pictures by the radiance cache: is the error that was asked for kept, and do sequences flicker?

The error of a picture is what `fogbank render --error` promises: the root mean square over the pixels of the difference
in luminance, relative to the pixel's plus a tenth of the picture's mean, without the worst 0.1 % of the pixels. Squared
errors are products of the differences to two independent halves of the reference: its noise has no part in them. Median
and 99th percentile can't do without it, and are held against wider bounds.

`make test` asks for 0.05 of scenes that take seconds; `-m accuracy` for 0.02, and of the shared rooms.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from fogbank import RenderOptions, Scene, Service
from fogbank.comparison import image_error
from fogbank.comparison.image_error import LUMINANCE, TRIMMED
from numpy.typing import NDArray

from tests.oracle import cache_references
from tests.oracle.cache_references import SIDE, STILLS, SWEEP, CacheCase
from tests.oracle.cases import SHARED

Pixels = NDArray[np.float64]

PICTURE: RenderOptions = {"integrator": "radiance-cache", "seed": 1, "pixel_type": "float", "size": (SIDE, SIDE)}
COARSE, FINE = 0.05, 0.02
WORST_PIXELS = 4.0
"""Times the error asked for that 99 % of the pixels keep below: a hundredth of the pixels beyond it would be a sixth of
the whole squared error and more, which the eye sees as splotches. Normal errors of one size everywhere have 2.6."""

# Errors where the promise is not kept, as measured; estimates are in the comments.
COARSE_SHORTFALLS = {
    "penumbra": 0.0499,  # 0.0492; more than a hundredth of the pixels are off by WORST_PIXELS
    "glow": 0.0823,  # 0.0925
}
FINE_SHORTFALLS = {
    "shafts": 0.0510,  # this one and those below before photons ended paths in dense fog
    "glow": 0.2497,
    "statues_room_fog": 0.0691,
}
SLACK = 1.1
"""By which an error may exceed what was measured, when the cache's decisions change a little."""


@dataclass(frozen=True)
class Outcome:
    """How wrong a picture is; all relative."""

    asked: float
    estimated: float
    """By the renderer."""
    error: float
    resolution: float
    """What the reference's noise may add to the squared error: two standard errors."""
    median: float
    percentile_99: float
    reference_median: float
    """Of the reference's own noise, as is the next one."""
    reference_99: float

    def __str__(self) -> str:
        """For people."""
        return (
            f"error {self.error:.4f}, asked for {self.asked}, estimated {self.estimated:.4f}; "
            f"median {self.median:.4f} (reference {self.reference_median:.4f}), "
            f"99 % {self.percentile_99:.4f} (reference {self.reference_99:.4f})"
        )

    def check(self, shortfall: float | None, request: pytest.FixtureRequest) -> None:
        """Fails if the promise isn't kept, or is where it is known not to be, or is missed by more than is known."""
        if shortfall is not None:
            if self.error > SLACK * shortfall:
                pytest.fail(f"worse than the known {shortfall}: {self}")
            reason = f"error {self.error:.4f} of {self.asked} is known; take it off the list once the promise is kept"
            request.applymarker(pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason))
        assert self.error**2 <= self.asked**2 + self.resolution, str(self)
        assert self.median <= np.hypot(self.asked, self.reference_median), str(self)
        assert self.percentile_99 <= np.hypot(WORST_PIXELS * self.asked, self.reference_99), str(self)


def relative(difference: Pixels, reference: Pixels) -> Pixels:
    """Luminance of a difference, relative as `--error` is."""
    grey = reference @ LUMINANCE
    return np.asarray(difference @ LUMINANCE / (grey + grey.mean() / 10.0))


def trimmed_mean(values: Pixels, size: Pixels) -> float:
    """Mean without the values of the pixels of the worst `size`."""
    order = np.argsort(size, axis=None)
    return float(values.ravel()[order[: order.size - round(order.size * TRIMMED)]].mean())


def judge(image: Pixels, halves: tuple[Pixels, Pixels], asked: float, estimated: float) -> Outcome:
    """Compares."""
    if not np.isfinite(image).all():
        pytest.fail("a value that is not finite")
    reference = (halves[0] + halves[1]) / 2.0
    size = np.abs(relative(image - reference, reference))
    products = relative(image - halves[0], reference) * relative(image - halves[1], reference)
    noise = np.abs(relative(halves[0] - halves[1], reference)) / 2.0
    # With noise of variance v in each half and error e a product has the variance 2 v e^2 + v^2; v is 2 noise^2.
    variance = 4.0 * noise**2 * asked**2 + 4.0 * noise**4 / 3.0
    return Outcome(
        asked=asked,
        estimated=estimated,
        error=float(np.sqrt(max(trimmed_mean(products, size), 0.0))),
        resolution=2.0 * float(np.sqrt(variance.sum())) / variance.size,
        median=float(np.median(size)),
        percentile_99=float(np.percentile(size, 99)),
        reference_median=float(np.median(noise)),
        reference_99=float(np.percentile(noise, 99)),
    )


def render(scene: Scene, options: RenderOptions) -> tuple[Pixels, float]:
    """A picture, and the renderer's estimate of its error."""
    job = scene.render(**options)
    image = np.asarray(job.result(), dtype=np.float64)
    assert job.statistics is not None
    return image, job.statistics.history[-1].estimated_error or np.inf


def still(case: CacheCase, error: float, service: Service) -> Outcome:
    """A picture of a scene of ours against its reference."""
    image, estimated = render(service.load(case.scene_file), {**PICTURE, "error": error})
    outcome = judge(image, cache_references.load(case), error, estimated)
    print(f"{case.name}: {outcome}")
    return outcome


@pytest.mark.parametrize("case", STILLS, ids=lambda case: case.name)
def test_error_is_kept(case: CacheCase, own_service: Service, request: pytest.FixtureRequest) -> None:
    still(case, COARSE, own_service).check(COARSE_SHORTFALLS.get(case.name), request)


@pytest.mark.accuracy
@pytest.mark.parametrize("case", STILLS, ids=lambda case: case.name)
def test_fine_error_is_kept(case: CacheCase, own_service: Service, request: pytest.FixtureRequest) -> None:
    still(case, FINE, own_service).check(FINE_SHORTFALLS.get(case.name), request)


def room(name: str, path: str, blocks: int, error: float, service: Service, folder: Path) -> Outcome:
    """A room of the shared data against its reference, both averaged over blocks x blocks of the reference's pixels.

    With the box filter a picture of fewer pixels is exactly that average. Skips where the data are absent.
    """
    original = SHARED / "data" / path
    reference = SHARED / "references" / f"{name}.exr"
    if not original.is_file() or not reference.is_file():
        pytest.skip(f"{original} or its reference is absent")
    # The references were made with the box filter, the files ask for another.
    copy = folder / original.parent.name
    shutil.copytree(original.parent, copy)
    scene_file = copy / original.name
    scene_file.chmod(0o644)
    text = original.read_text(encoding="utf-8")
    for other in ("gaussian", "tent"):
        text = text.replace(f'<rfilter type="{other}"', '<rfilter type="box"')
    scene_file.write_text(text, encoding="utf-8")

    def half(suffix: str) -> Pixels:
        pixels = image_error.read(reference.with_name(f"{name}_{suffix}.exr"))
        height, width, channels = pixels.shape
        return np.asarray(pixels.reshape(height // blocks, blocks, width // blocks, blocks, channels).mean((1, 3)))

    halves = half("a"), half("b")
    height, width, _ = halves[0].shape
    image, estimated = render(service.load(scene_file), {**PICTURE, "error": error, "size": (width, height)})
    outcome = judge(image, halves, error, estimated)
    print(f"{name}, {width} x {height}: {outcome}")
    return outcome


def test_error_is_kept_in_a_room(own_service: Service, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    name = "statues_room_fog"
    outcome = room(name, "statues/room_fog.xml", 4, COARSE, own_service, tmp_path)
    outcome.check(COARSE_SHORTFALLS.get(name), request)


@pytest.mark.accuracy
@pytest.mark.parametrize(
    ("name", "path", "blocks"),
    [
        ("statues_room_fog", "statues/room_fog.xml", 4),
        ("staircase2_fog", "staircase2/fog.xml", 6),
        ("classroom_fog", "classroom/fog.xml", 6),
    ],
)
def test_fine_error_is_kept_in_rooms(
    name: str, path: str, blocks: int, own_service: Service, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    room(name, path, blocks, FINE, own_service, tmp_path).check(FINE_SHORTFALLS.get(name), request)


def test_a_sweep_at_one_epoch_does_not_flicker(own_service: Service) -> None:
    """From frame to frame pictures change as the references do, up to the error asked for.

    Two frames with errors of their own would differ by sqrt(2) times that; errors that stay where they are, by less.
    """
    scene = own_service.load(SWEEP[0].scene_file)
    cameras = [case.camera for case in SWEEP if case.camera is not None]
    options: RenderOptions = {**PICTURE, "error": COARSE}
    epoch = scene.cache.fill(cameras, **options).epoch
    frames = [render(scene, {**options, "camera": camera, "epoch": epoch})[0] for camera in cameras]
    halves = [cache_references.load(case) for case in SWEEP]
    reference = np.mean(halves, axis=(0, 1))
    products, sizes, noises = [], [], []
    for before in range(len(SWEEP) - 1):
        change = frames[before + 1] - frames[before]
        true = [halves[before + 1][half] - halves[before][half] for half in (0, 1)]
        products.append(relative(change - true[0], reference) * relative(change - true[1], reference))
        sizes.append(np.abs(relative(change - (true[0] + true[1]) / 2.0, reference)))
        noises.append(np.abs(relative(true[0] - true[1], reference)) / 2.0)
    flicker = float(np.sqrt(max(trimmed_mean(np.array(products), np.array(sizes)), 0.0)))
    worst, reference_worst = float(np.percentile(sizes, 99)), float(np.percentile(noises, 99))
    report = f"flicker {flicker:.4f}, 99 % {worst:.4f} (reference {reference_worst:.4f}), error asked for {COARSE}"
    print(report)
    assert flicker <= COARSE, report
    assert worst <= np.hypot(WORST_PIXELS * COARSE, reference_worst), report
