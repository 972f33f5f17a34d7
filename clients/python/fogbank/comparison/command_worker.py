"""Renders with a command of the user's own.

The command is a template with the placeholders {scene} (the prepared XML), {output} (EXR file to write, linear Rec. 709
R, G, B), {quality} (a whole number from 1; render time should grow in proportion, like samples per pixel), {seed},
{threads}, {width}, {height} and {max_depth}. The last line that it prints is a JSON object with "render_seconds" (wall
clock, without start-up, compilation and loading); "cpu_seconds" of the same, "startup_seconds", "load_seconds" and
"version" are optional. Without "cpu_seconds" the whole process counts.
"""

from __future__ import annotations

import json
import resource
import shlex
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

from fogbank.comparison.worker import Render, Rendered, Start, Started

_ERROR_CHARACTERS = 300


class CommandWorker:
    """See `worker.Worker`."""

    def start(self, start: Start) -> Started:
        """Runs the command with quality 1, to learn its speed."""
        self._start = start
        output = Path(start.scene).with_suffix(".first.exr")
        begin = time.perf_counter()
        report = self._run(1, 0, str(output))
        seconds = time.perf_counter() - begin
        output.unlink(missing_ok=True)
        self._seconds_of_quality = max(report["render_seconds"], 1e-6)
        load_seconds = float(report.get("load_seconds", 0.0))
        startup_seconds = float(report.get("startup_seconds", seconds - report["render_seconds"] - load_seconds))
        versions = {"command": str(report.get("version", self._start.settings["command"]))}
        return Started(startup_seconds, load_seconds, 0.0, versions)

    def render(self, render: Render) -> Rendered:
        """Runs the command with the quality that its speed so far allows."""
        if render.seconds is None:
            message = "a command makes no records"
            raise ValueError(message)
        quality = max(1, round(render.seconds / self._seconds_of_quality))
        report = self._run(quality, render.seed, render.output)
        self._seconds_of_quality = max(report["render_seconds"] / quality, 1e-6)
        return Rendered(
            wall_seconds=report["render_seconds"],
            cpu_seconds=report["cpu_seconds"],
            samples_per_pixel=quality,
            peak_bytes=resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024,
        )

    def _run(self, quality: int, seed: int, output: str) -> dict[str, Any]:
        width, height = self._start.size
        values = {
            "scene": self._start.scene,
            "output": output,
            "quality": quality,
            "seed": seed,
            "threads": self._start.threads,
            "width": width,
            "height": height,
            "max_depth": self._start.max_depth,
        }
        # Split before the values come in: they may hold spaces.
        command = [part.format(**values) for part in shlex.split(self._start.settings["command"])]
        before = _children_cpu_seconds()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = (done.stderr or done.stdout).strip()[-_ERROR_CHARACTERS:]
            code = done.returncode
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"
            message = f"{command[0]} ended with {how}" + (f": {said}" if said else "")
            raise RuntimeError(message)
        try:
            report: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
            report["render_seconds"] = float(report["render_seconds"])
        except (IndexError, KeyError, TypeError, ValueError):
            message = f'the last line that {command[0]} prints is to be {{"render_seconds": ...}}'
            raise RuntimeError(message) from None
        if not Path(output).is_file():
            message = f"{command[0]} wrote no {output}"
            raise RuntimeError(message)
        report["cpu_seconds"] = float(report.get("cpu_seconds", _children_cpu_seconds() - before))
        return report


def _children_cpu_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
