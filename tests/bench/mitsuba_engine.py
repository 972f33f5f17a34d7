"""Mitsuba 3 as the engine to compare with: one process per variant, as a variant is set once for all.

Run as a program it answers one JSON command a line, like the engine's own `fogbank_bench`:

    {"command": "load", "scene": path, "width", "height"}
    {"command": "render", "samples_per_pixel", "max_depth", "rr_depth", "seed", "output": path of an EXR file or ""}
"""

import importlib
import json
import os
import re
import sys
import time
from pathlib import Path
from typing import Any

LLVM_LIBRARIES = (
    Path("/usr/lib/llvm-19/lib/libLLVM.so.19.1"),
    Path("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"),
)
FILTER = re.compile(r"<rfilter[^>]*/>|<rfilter.*?</rfilter>", re.DOTALL)


def prepare(text: str, width: int, height: int) -> str:
    """The scene with this film size, and with the filter box as `fogbank_bench` renders it."""
    replacements = [(FILTER, '<rfilter type="box"/>')]
    for name, value in (("width", width), ("height", height)):
        replacements.append(
            (re.compile(rf'<integer name="{name}"[^>]*/>'), f'<integer name="{name}" value="{value}"/>')
        )
    for pattern, replacement in replacements:
        text, count = pattern.subn(replacement, text)
        if count != 1:
            message = f"expected one {pattern.pattern}, found {count}"
            raise ValueError(message)
    return text


class MitsubaEngine:
    """Renders one scene at a time with one variant."""

    def __init__(self, variant: str) -> None:
        for library in LLVM_LIBRARIES:
            if library.exists():
                os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))
        # Its stubs are those of another variant than the one that is set here.
        mitsuba: Any = importlib.import_module("mitsuba")
        mitsuba.set_variant(variant)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        self._mitsuba = mitsuba
        self._scene: Any = None

    def load(self, scene: str, width: int, height: int) -> dict[str, Any]:
        """Loads a scene."""
        path = Path(scene).resolve()
        self._mitsuba.file_resolver().prepend(str(path.parent))
        start = time.perf_counter()
        self._scene = self._mitsuba.load_string(prepare(path.read_text(encoding="utf-8"), width, height))
        return {"load_seconds": time.perf_counter() - start}

    def render(self, samples_per_pixel: int, max_depth: int, seed: int, rr_depth: int, output: str) -> dict[str, Any]:
        """Renders; CPU seconds of all threads meanwhile, without loading and without writing the file."""
        import numpy

        integrator = self._mitsuba.load_dict({"type": "volpath", "max_depth": max_depth, "rr_depth": rr_depth})
        start, cpu_start = time.perf_counter(), time.process_time()
        image = self._mitsuba.render(self._scene, spp=samples_per_pixel, seed=seed, integrator=integrator)
        pixels = numpy.array(image)  # waits for the kernel
        cpu, wall = time.process_time() - cpu_start, time.perf_counter() - start
        if output:
            self._mitsuba.Bitmap(pixels[:, :, :3]).write(output)
        samples = pixels.shape[0] * pixels.shape[1] * samples_per_pixel
        return {"cpu_seconds": cpu, "wall_seconds": wall, "samples": samples}


def main() -> None:
    """Answers commands until standard input ends."""
    engine = MitsubaEngine(sys.argv[1])
    for line in sys.stdin:
        command = json.loads(line)
        try:
            answer = engine.load(**command) if command.pop("command") == "load" else engine.render(**command)
        except Exception as error:
            answer = {"error": str(error)}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
