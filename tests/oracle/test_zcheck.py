"""The comparison itself, on synthetic renders whose truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.oracle import zcheck

Array = NDArray[np.float64]
HEIGHT, WIDTH, BATCHES = 32, 40, 16


def truth() -> Array:
    y, x = np.meshgrid(np.linspace(0, 1, HEIGHT), np.linspace(0, 1, WIDTH), indexing="ij")
    return np.stack([0.2 + x, 0.5 + 0.3 * y, 0.1 + x * y], -1)


def renders(seed: int, mean: Array, noise: float = 0.05, batches: int = BATCHES) -> zcheck.Estimate:
    generator = np.random.default_rng(seed)
    return zcheck.estimate(mean * (1 + noise * generator.standard_normal(mean.shape)) for _ in range(batches))


def test_estimate_is_mean_and_variance_of_the_mean() -> None:
    images = np.random.default_rng(1).random((7, 3, 4, 3))
    result = zcheck.estimate(images)
    np.testing.assert_allclose(result.mean, images.mean(0), rtol=1e-12)
    np.testing.assert_allclose(result.variance, images.var(0, ddof=1) / 7, rtol=1e-10)
    np.testing.assert_allclose(result.image_variance, images.mean((1, 2)).var(0, ddof=1) / 7, rtol=1e-10)


def test_equal_renders_pass() -> None:
    # 60 pairs, three tests at 1 % each (the image's at 0.8 %): 1.7 failures expected, more than 6 in 0.2 %.
    outcomes = [zcheck.compare(renders(2 * i, truth()), renders(2 * i + 1, truth(), batches=32)) for i in range(60)]
    assert sum(not outcome.passed for outcome in outcomes) <= 6
    # z is standard normal in spite of 16 batches, a little less for the floored variance.
    assert 0.9 < np.sqrt(np.mean([(outcome.z**2).mean() for outcome in outcomes])) < 1.02


def test_heavy_tails_pass() -> None:
    """Noise as of fireflies: 2 % of the batches are 15 times too bright."""

    def spiky(seed: int) -> zcheck.Estimate:
        generator = np.random.default_rng(seed)
        share = 0.02
        return zcheck.estimate(
            truth() * (1 + 14 * (generator.random(truth().shape) < share)) / (1 + 14 * share) for _ in range(BATCHES)
        )

    outcomes = [zcheck.compare(spiky(1000 + i), spiky(2000 + i)) for i in range(20)]
    assert sum(not outcome.passed for outcome in outcomes) <= 3


def test_one_percent_brighter_fails() -> None:
    # Standard error of the image mean: 5 % / sqrt(16 x 1280) = 0.035 %, so 1 % is 20 of them.
    outcome = zcheck.compare(renders(1, 1.01 * truth()), renders(2, truth()))
    assert any(failure.startswith("IMAGE") for failure in outcome.failures)


def test_wrong_region_fails_though_the_mean_agrees() -> None:
    wrong = truth()
    wrong[8:14, 10:16] *= 1.5
    wrong *= truth().mean((0, 1)) / wrong.mean((0, 1))
    outcome = zcheck.compare(renders(3, wrong), renders(4, truth()))
    assert any(failure.startswith("PIXELS") for failure in outcome.failures)
    assert not any(failure.startswith("IMAGE") for failure in outcome.failures)
    assert np.abs(outcome.z[8:14, 10:16]).mean() > 6


def test_slightly_wrong_object_fails_by_blocks() -> None:
    # 5 % in one block: 4 standard errors of a pixel, invisible among 99.75 %, but 32 of the block.
    wrong = truth()
    wrong[16:24, 16:24] *= 1.05
    outcome = zcheck.compare(renders(5, wrong), renders(6, truth()))
    assert any(failure.startswith("BLOCKS: the 8 x 8 block at x 16 y 16") for failure in outcome.failures)


def test_noise_free_images() -> None:
    exact = zcheck.estimate([truth()] * 4)
    assert zcheck.compare(exact, zcheck.estimate([truth() * (1 + 1e-6)] * 4)).passed
    assert not zcheck.compare(exact, zcheck.estimate([truth() * 1.0001] * 4)).passed


def test_halves_stand_in_for_batches() -> None:
    outcomes = []
    for i in range(30):
        generator = np.random.default_rng(500 + i)
        first, second = (truth() * (1 + 0.01 * generator.standard_normal(truth().shape)) for _ in range(2))
        reference = zcheck.estimate_from_halves((first + second) / 2, first, second)
        outcomes.append(zcheck.compare(renders(600 + i, truth()), reference).passed)
    assert outcomes.count(False) <= 4


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="1 batches have no variance"):
        zcheck.estimate([truth()])
    with pytest.raises(ValueError, match="1 values that are not finite"):
        broken = truth()
        broken[0, 0, 0] = np.nan
        zcheck.estimate([truth(), broken])
    with pytest.raises(ValueError, match="the reference"):
        zcheck.compare(renders(1, truth()), renders(1, truth()[:8]))


def test_report_names_the_worst_pixel_and_saves_pictures(tmp_path: Path) -> None:
    wrong = truth()
    wrong[20:24, 30:34] *= 0.3
    outcome = zcheck.compare(renders(7, wrong), renders(8, truth()))
    assert any(f"pixel x {x} y {y}" in outcome.report() for x in range(30, 34) for y in range(20, 24))
    outcome.save(tmp_path / "out", "case")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["case_ours.exr", "case_reference.exr", "case_z.exr", "case_z.png"]
