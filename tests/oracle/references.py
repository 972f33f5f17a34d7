"""Mitsuba's side of the oracle: renders references and stores them as EXR files.

    python -m tests.oracle.references [--list] [--missing] [NAME ...]      from the root of the repository

A file holds mean (R, G, B) and variance of the mean (variance.R, ...), float32, and in its header as JSON: Mitsuba's
version and variant, integrator, samples, batches, seed, the image mean with its variance, and the SHA-256 of the scene
with all its files. Needs the pinned mitsuba wheel; tests that only compare do not.
"""

from __future__ import annotations

import argparse
import ctypes.util
import json
import os
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from tests.oracle import zcheck
from tests.oracle.cases import Case, scene_digest, stored_cases

ATTRIBUTE = "reference"
SEED = 1


def mitsuba() -> Any:  # noqa: ANN401 - a module without type information
    """The module with a variant set: llvm_ad_rgb if LLVM can be loaded, else scalar_rgb (much slower, same meaning)."""
    library = os.environ.get("DRJIT_LIBLLVM_PATH") or next(
        (found for name in ("LLVM-19", "LLVM-18", "LLVM-17", "LLVM-16", "LLVM-15", "LLVM")
         if (found := ctypes.util.find_library(name))), None
    )  # fmt: skip
    if library:
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    import mitsuba as module

    if module.variant() is None:
        module.set_variant("llvm_ad_rgb" if library else "scalar_rgb")
        module.set_log_level(module.LogLevel.Warn)
    return module


def mitsuba_batches(case: Case, *, spp: int, batches: int, first_seed: int = SEED) -> Iterator[np.ndarray[Any, Any]]:
    """Independent Mitsuba renders (h, w, 3) of the case; its crop window only."""
    module = mitsuba()
    scene = module.load_file(str(case.mitsuba_scene), **case.parameters)
    # The scene's own integrator may be wrapped (moment) or have Russian roulette set in a way that needs more samples.
    integrator = module.load_dict({"type": case.reference_integrator, "max_depth": _max_depth(case), "rr_depth": 1000})
    for batch in range(batches):
        image = module.render(scene, integrator=integrator, spp=spp, seed=first_seed + batch)
        yield np.array(image)[..., :3]


def _max_depth(case: Case) -> int:
    """The scene's max_depth, its parameters resolved."""
    files = [case.mitsuba_scene]
    values = dict(case.parameters)
    while files:
        path = files.pop(0)
        document = ElementTree.parse(path)
        for element in document.iter("default"):
            values.setdefault(element.get("name", ""), element.get("value", ""))
        for element in document.iter("integer"):
            if element.get("name") == "max_depth":
                value = element.get("value", "")
                return int(values[value[1:]] if value.startswith("$") else value)
        files += [case.mitsuba_scene.parent / element.get("filename", "") for element in document.iter("include")]
    raise ValueError(f"{case.mitsuba_scene}: no max_depth")


def render(case: Case) -> zcheck.Estimate:
    """A fresh reference."""
    return zcheck.estimate(mitsuba_batches(case, spp=case.reference_spp, batches=case.reference_batches))


def store(case: Case, result: zcheck.Estimate) -> None:
    """Writes case.reference."""
    module = mitsuba()
    description = {
        "mitsuba": module.__version__,
        "variant": module.variant(),
        "integrator": case.reference_integrator,
        "samples_per_pixel": case.reference_spp * case.reference_batches,
        "batches": case.reference_batches,
        "seed": SEED,
        "image_mean": result.image_mean.tolist(),
        "image_variance": result.image_variance.tolist(),
        "scene_sha256": scene_digest(case),
    }
    case.reference.parent.mkdir(parents=True, exist_ok=True)
    channels = {"RGB": result.mean}
    channels |= {f"variance.{'RGB'[k]}": result.variance[..., k] for k in range(3)}
    zcheck.write_exr(case.reference, channels, {ATTRIBUTE: json.dumps(description, sort_keys=True)})


def description(path: Path) -> dict[str, Any]:
    """What the header of a stored reference says."""
    found: dict[str, Any] = json.loads(OpenEXR.File(str(path), header_only=True).header()[ATTRIBUTE])
    return found


def load(case: Case) -> zcheck.Estimate:
    """A stored reference. Raises ValueError if the scene has changed since, FileNotFoundError if there is none."""
    if not case.reference.is_file():
        raise FileNotFoundError(f"no reference; run: python -m tests.oracle.references {case.name}")
    about = description(case.reference)
    if about["scene_sha256"] != scene_digest(case):
        raise ValueError(f"the scene has changed since; run: python -m tests.oracle.references {case.name}")
    channels = OpenEXR.File(str(case.reference), separate_channels=True).channels()
    mean = np.stack([channels[name].pixels for name in "RGB"], -1).astype(np.float64)
    variance = np.stack([channels[f"variance.{name}"].pixels for name in "RGB"], -1).astype(np.float64)
    return zcheck.Estimate(
        mean, variance, np.array(about["image_mean"]), np.array(about["image_variance"]), about["batches"]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description="Render and store Mitsuba's references of the oracle scenes.")
    parser.add_argument("names", nargs="*", help="cases; default: all whose scene is present")
    parser.add_argument("--list", action="store_true", help="list the cases and what is stored, render nothing")
    parser.add_argument("--missing", action="store_true", help="only those whose reference is missing or out of date")
    arguments = parser.parse_args()
    cases = {case.name: case for case in stored_cases()}
    unknown = sorted(set(arguments.names) - set(cases))
    if unknown:
        parser.error(f"no case named {', '.join(unknown)}")
    for case in (cases[name] for name in arguments.names or sorted(cases)):
        if not case.available:
            print(f"{case.name}: scene absent, skipped")
            continue
        current = case.reference.is_file() and description(case.reference)["scene_sha256"] == scene_digest(case)
        if arguments.list:
            print(f"{case.name}: {'stored' if current else 'out of date or missing'}")
        elif not (arguments.missing and current):
            result = render(case)
            store(case, result)
            error = np.sqrt(result.image_variance) / np.maximum(result.image_mean, 1e-9)
            print(f"{case.name}: mean {result.image_mean}, relative standard error {error.max():.2e}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
