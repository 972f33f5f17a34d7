"""Fogbank's volpath against Mitsuba 3's, pixel by pixel: see zcheck.py for the statistics and cases.py for the scenes.

Run all with `python -m pytest tests/oracle`, one with `-k bsdf_plastic`; `--fresh` renders Mitsuba's references anew.
Pictures of what failed: out/oracle/.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from fogbank import Service
from numpy.typing import NDArray

from tests.oracle import references, zcheck
from tests.oracle.cases import REFERENCES, SHARED, Case, stored_cases
from tests.oracle.fogbank_batches import render_batches

# The rooms of the shared data: name of the reference, scene, samples per batch. The film is 192 x 108, box filter.
ROOMS = [
    ("statues_room_fog", "statues/room_fog.xml", 8),
    ("classroom_fog", "classroom/fog.xml", 8),
    ("staircase2_fog", "staircase2/fog.xml", 8),
]
FIRST_SEED = 1000
RETRY_SEED = 9000


def judge(
    name: str,
    ours: Callable[[int, int], zcheck.Estimate],
    reference: zcheck.Estimate,
    evidence: Path,
    *,
    independent_pixels: bool = True,
) -> None:
    """Compares; when that fails, once more with other seeds and 4 times the samples, and then it counts.

    Some hundred comparisons, three tests each at 1 %, fail once or twice by chance. A second independent render makes
    that rare for the whole suite, while a true difference of 3 standard errors becomes one of 6.
    """
    outcome = zcheck.compare(ours(1, FIRST_SEED), reference, independent_pixels=independent_pixels)
    if not outcome.passed:
        print(f"{name}, first attempt:\n{outcome.report()}")
        outcome = zcheck.compare(ours(4, RETRY_SEED), reference, independent_pixels=independent_pixels)
    print(f"{name}:\n{outcome.report()}")
    if not outcome.passed:
        outcome.save(evidence, name)
        pytest.fail(f"{name}: {outcome.report()}\npictures: {evidence}/{name}_*", pytrace=False)


@pytest.mark.parametrize("case", stored_cases(), ids=lambda case: case.name)
def test_like_mitsuba(case: Case, service: Service, fresh: bool, evidence: Path) -> None:
    if not case.available:
        pytest.skip(f"{case.scene} is absent")
    if fresh:
        pytest.importorskip("mitsuba")
    reference = references.render(case) if fresh else references.load(case)

    def ours(factor: int, seed: int) -> zcheck.Estimate:
        return zcheck.estimate(
            render_batches(
                service,
                case.scene,
                spp=factor * case.spp,
                batches=case.batches,
                first_seed=seed,
                root=case.root,
                parameters=case.parameters,
            )
        )

    judge(case.name, ours, reference, evidence, independent_pixels=case.box_filter)


def shared_reference(name: str) -> zcheck.Estimate:
    def pixels(suffix: str) -> NDArray[np.float32]:
        file = OpenEXR.File(str(SHARED / "references" / f"{name}{suffix}.exr"))
        return np.asarray(file.channels()["RGB"].pixels)

    return zcheck.estimate_from_halves(pixels(""), pixels("_a"), pixels("_b"))


@pytest.mark.parametrize(("name", "path", "spp"), ROOMS, ids=[room[0] for room in ROOMS])
def test_shared_room(name: str, path: str, spp: int, service: Service, evidence: Path, tmp_path: Path) -> None:
    original = SHARED / "data" / path
    if not original.is_file() or not (SHARED / "references" / f"{name}.exr").is_file():
        pytest.skip(f"{original} or its reference is absent")
    # The references were made with the box filter, the files ask for another.
    folder = tmp_path / original.parent.name
    shutil.copytree(original.parent, folder)
    scene = folder / original.name
    scene.chmod(0o644)
    text = original.read_text()
    boxed = text.replace('<rfilter type="gaussian"', '<rfilter type="box"').replace(
        '<rfilter type="tent"', '<rfilter type="box"'
    )
    assert '<rfilter type="box"' in boxed
    scene.write_text(boxed)

    def ours(factor: int, seed: int) -> zcheck.Estimate:
        return zcheck.estimate(
            render_batches(service, scene, spp=factor * spp, batches=16, first_seed=seed, size=(192, 108))
        )

    judge(name, ours, shared_reference(name), evidence)


def test_every_reference_belongs_to_a_case() -> None:
    assert {path.stem for path in REFERENCES.glob("*.exr")} == {case.name for case in stored_cases()}
