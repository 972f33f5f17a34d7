"""Error of whole pictures against CPU time: Fogbank's cache, and Mitsuba 3 followed by the denoiser OIDN.

References come from Fogbank's own `volpath`, which tests/oracle checks against Mitsuba's: two independent halves,
rendered once and kept in out/bench/references. Start-up, loading and just-in-time compilation are not counted,
denoising is. CPU seconds are those of all threads.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from fogbank.comparison import image_error
from fogbank.comparison.analysis import cost_at
from fogbank.comparison.denoise import denoise
from fogbank.comparison.exr_writer import write_exr

from tests.bench import comparison, engines
from tests.bench.comparison import Case

REFERENCES = engines.OUTPUT / "references"
REFERENCE_SAMPLES = 256
"""Of each half: the product of their errors averages out over the pixels to 1e-4 and less."""
MOST_SAMPLES = 4096
"""A pixel's, however far the error is."""
ERRORS = (0.1, 0.05, 0.02, 0.01)
MITSUBA_SAMPLES = (4, 16, 64)
MITSUBA = "llvm_ad_rgb"
GOALS = {"shafts": 1e-3, "stairs": 1e-3, "glow": 1e-3, "penumbra": 1e-4, "room_fog": 1e-3}
"""Relative MSE that a cold cache is to reach within GOAL_SECONDS."""
GOAL_SECONDS = 2.0


def cases() -> list[Case]:
    """The scenes that are there."""
    scenes = engines.ROOT / "scenes"
    more = [
        Case("stairs", scenes / "stairs" / "stairs.xml", 256, 256, 16, 8),
        Case("penumbra", scenes / "penumbra" / "penumbra.xml", 256, 256, 12, 8),
    ]
    return comparison.cases() + more


def references(case: Case, threads: int) -> tuple[Path, Path]:
    """Both halves."""
    REFERENCES.mkdir(parents=True, exist_ok=True)
    name = f"{case.name}_{case.width}x{case.height}_{REFERENCE_SAMPLES}"
    halves = (REFERENCES / f"{name}_a.exr", REFERENCES / f"{name}_b.exr")
    missing = [(path, seed) for seed, path in enumerate(halves, start=1001) if not path.exists()]
    if missing:
        with engines.fogbank() as engine:
            engine.ask("load", scene=str(case.path))
            for path, seed in missing:
                unfinished = path.with_suffix(".unfinished.exr")
                engine.ask(
                    "render",
                    integrator="volpath",
                    width=case.width,
                    height=case.height,
                    samples_per_pixel=REFERENCE_SAMPLES,
                    max_depth=case.max_depth,
                    seed=seed,
                    threads=threads,
                    output=str(unfinished),
                )
                unfinished.rename(path)
    return halves


def denoised(path: Path) -> float:
    """Replaces the picture by its denoised version; CPU seconds."""
    noisy = image_error.read(path)
    denoise(noisy)  # the first call loads the network
    clean = denoise(noisy)
    write_exr(path, clean.pixels)
    return clean.cpu_seconds


def measure(case: Case, threads: int) -> dict[str, Any]:
    """Both renderers at growing quality."""
    half_a, half_b = (image_error.read(path) for path in references(case, threads))
    lines: list[dict[str, Any]] = []

    def add(method: str, setting: str, cpu_seconds: float, output: Path, **more: Any) -> None:  # noqa: ANN401 - JSON
        error = image_error.measure(image_error.read(output), half_a, half_b)
        lines.append({"method": method, "setting": setting, "cpu_seconds": cpu_seconds, **asdict(error), **more})

    output = engines.OUTPUT / f"pictures_{case.name}.exr"
    with engines.fogbank() as ours:
        ours.ask("load", scene=str(case.path))
        for error in ERRORS:
            answer = ours.ask(
                "render",
                integrator="radiance-cache",
                error=error,
                samples_per_pixel=MOST_SAMPLES,
                width=case.width,
                height=case.height,
                max_depth=case.max_depth,
                seed=1,
                threads=threads,
                output=str(output),
            )
            add("radiance-cache", f"{error:g}", answer["cpu_seconds"], output, records=answer["records_new"])
    with engines.mitsuba(MITSUBA) as theirs:
        theirs.ask("load", scene=str(case.path), width=case.width, height=case.height)
        common = {"max_depth": case.max_depth, "rr_depth": case.mitsuba_rr_depth, "output": str(output)}
        theirs.ask("render", samples_per_pixel=1, seed=0, **common)
        for samples in MITSUBA_SAMPLES:
            answer = theirs.ask("render", samples_per_pixel=samples, seed=1, **common)
            add("mitsuba", f"{samples}", answer["cpu_seconds"], output)
            add("mitsuba+oidn", f"{samples}", answer["cpu_seconds"] + denoised(output), output)
    return {"scene": case.name, "width": case.width, "height": case.height, "lines": lines}


def cpu_seconds_to(lines: list[dict[str, Any]], method: str, error: float) -> float | None:
    """CPU seconds to a trimmed relative MSE; None: not reached."""
    return cost_at([(line["cpu_seconds"], line["trimmed"]) for line in lines if line["method"] == method], error)


def table(results: list[dict[str, Any]]) -> str:
    """For people."""
    lines = [
        "scene      method          setting  CPU s    relMSE   trimmed   soft   median  99 %    records",
        "-" * 96,
    ]
    for result in results:
        for line in result["lines"]:
            lines.append(
                f"{result['scene']:10} {line['method']:15} {line['setting']:>7} {line['cpu_seconds']:6.2f}"
                f" {line['relative_mse']:9.2g} {line['trimmed']:9.2g} {line['soft']:6.2f} {line['median']:8.4f}"
                f" {line['percentile_99']:7.4f} {line.get('records', ''):>8}"
            )
        goal = GOALS[result["scene"]]
        ours = cpu_seconds_to(result["lines"], "radiance-cache", goal)
        theirs = cpu_seconds_to(result["lines"], "mitsuba+oidn", goal)
        lines.append(
            f"{'':10} to relMSE {goal:g}: radiance-cache {ours or float('nan'):.1f} (goal {GOAL_SECONDS:g}),"
            f" mitsuba+oidn {theirs or float('nan'):.1f} CPU s"
            + (f", ratio {theirs / ours:.1f}" if ours and theirs else "")
        )
    return "\n".join(lines)
