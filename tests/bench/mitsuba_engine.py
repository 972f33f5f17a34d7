"""Mitsuba 3 as the engine to compare with. Run as a program it answers one JSON command a line, like `fogbank_bench`:

    {"command": "load", "scene": path, "width", "height"}
    {"command": "render", "samples_per_pixel", "max_depth", "rr_depth", "seed", "output": path of an EXR file or ""}

Times are without loading and without writing the file; CPU seconds are those of all threads.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from fogbank.comparison.exr_writer import write_exr
from fogbank.comparison.mitsuba_renderer import MitsubaRenderer
from fogbank.comparison.scene_text import prepare_text


def load(renderer: MitsubaRenderer, scene: str, width: int, height: int) -> dict[str, Any]:
    """Loads a scene in this size and with the filter box, as `fogbank_bench` renders it."""
    path = Path(scene).resolve()
    text = prepare_text(path.read_text(encoding="utf-8"), (width, height), {})
    return {"load_seconds": renderer.load(text, path.parent)}


def render(
    renderer: MitsubaRenderer, samples_per_pixel: int, max_depth: int, seed: int, rr_depth: int, output: str
) -> dict[str, Any]:
    """Renders."""
    done = renderer.render(samples_per_pixel, seed, max_depth, rr_depth)
    if output:
        write_exr(Path(output), done.pixels)
    samples = done.pixels.shape[0] * done.pixels.shape[1] * samples_per_pixel
    return {"cpu_seconds": done.cpu_seconds, "wall_seconds": done.wall_seconds, "samples": samples}


def main() -> None:
    """Answers commands until standard input ends."""
    renderer = MitsubaRenderer(sys.argv[1])
    for line in sys.stdin:
        command = json.loads(line)
        try:
            answer = (load if command.pop("command") == "load" else render)(renderer, **command)
        except Exception as error:
            answer = {"error": str(error)}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
