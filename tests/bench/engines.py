"""Rendering engines as child processes that answer one JSON command a line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

ROOT = Path(__file__).resolve().parents[2]
BINARIES = ROOT / "build" / os.environ.get("PRESET", "release") / "bin"
SHARED = Path(os.environ.get("FOGBANK_SHARED", ROOT.parent / "shared"))
OUTPUT = ROOT / "out" / "bench"


class EngineError(RuntimeError):
    """The engine said that it failed, or ended."""


class Engine:
    """A child process; use it as a context manager."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env={**os.environ, **(environment or {})},
        )

    def __enter__(self) -> Self:
        """Nothing more to do: the process is there."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the process by closing its input."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def ask(self, command: str, **arguments: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """The engine's answer; raises EngineError."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"command": command, **arguments}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            message = f"{self._process.args!r} ended with status {self._process.wait()}"
            raise EngineError(message)
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise EngineError(str(answer["error"]))
        return answer


def fogbank(environment: Mapping[str, str] | None = None) -> Engine:
    """Fogbank's engine."""
    return Engine([str(BINARIES / "fogbank_bench")], environment)


def mitsuba(variant: str) -> Engine:
    """Mitsuba 3."""
    return Engine([sys.executable, str(Path(__file__).with_name("mitsuba_engine.py")), variant])
