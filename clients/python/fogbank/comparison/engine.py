"""A method at work: a child process with a memory limit that answers one JSON command a line.

What happens to a method stays in its process: a crash, a hang or a lack of memory ends the process and is reported as
an `EngineError`, and the comparison goes on.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from types import TracebackType
from typing import Any, Literal, Self, TypeAlias

Failure: TypeAlias = Literal["failed", "crashed", "out of memory", "timed out"]

_STOP_SECONDS = 15.0
_STDERR_CHARACTERS = 400
_MEMORY_SIGNS = ("MemoryError", "bad_alloc", "annot allocate memory", "ut of memory", "jitc_malloc", "oom")


class EngineError(RuntimeError):
    """What a method did instead of answering.

    Attributes:
        kind: "failed": it answered with an error and goes on; else its process is gone.
    """

    def __init__(self, kind: Failure, message: str) -> None:
        """`message` says what is known."""
        super().__init__(message)
        self.kind: Failure = kind


class Engine:
    """The process of one method; a context manager that ends it."""

    def __init__(self, kind: str, memory_bytes: int) -> None:
        """Starts `fogbank.comparison.worker` for methods of this kind (`methods.Kind`).

        Args:
            kind: what the worker renders with.
            memory_bytes: most private memory of the process and of each of its children.
        """
        self._memory_bytes = memory_bytes
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - closed by stop()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fogbank.comparison.worker", kind, str(memory_bytes)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            text=True,
            # Ctrl-C is for the comparison, which then ends its engines; and the whole group can be ended.
            start_new_session=True,
        )
        self._answers: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, name="fogbank-engine", daemon=True).start()

    def __enter__(self) -> Self:
        """This object."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Ends the process."""
        self.stop()

    def ask(self, command: str, timeout: float, **arguments: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """The worker's answer; raises EngineError. After `timeout` seconds the process is killed."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps({"command": command, **arguments}) + "\n")
            self._process.stdin.flush()
        try:
            line = self._answers.get(timeout=timeout)
        except queue.Empty:
            self._kill()
            raise EngineError("timed out", f"no answer after {timeout:.0f} s") from None
        if not line:
            raise self._end()
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            message = str(answer["error"])
            raise EngineError("out of memory" if self._speaks_of_memory(message) else "failed", self._limited(message))
        return answer

    def stop(self) -> None:
        """Ends the process by closing its input, or by force; harmless when repeated."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            self._process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            self._kill()
        self._stderr.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._answers.put(line)
        self._answers.put("")

    def _kill(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _end(self) -> EngineError:
        """Why the process is gone."""
        status = self._process.wait()
        self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, self._stderr.tell() - _STDERR_CHARACTERS))
        said = self._stderr.read().decode(errors="replace").strip()
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        message = f"its process ended with {how}" + (f": {said}" if said else "")
        # SIGKILL that we did not send is the system's way to say that memory is short.
        if status == -signal.SIGKILL or self._speaks_of_memory(said):
            return EngineError("out of memory", self._limited(message))
        return EngineError("crashed", message)

    def _speaks_of_memory(self, message: str) -> bool:
        return any(sign in message for sign in _MEMORY_SIGNS)

    def _limited(self, message: str) -> str:
        if not self._speaks_of_memory(message):
            return message
        return f"{message} (limit {self._memory_bytes / 2**30:.3g} GiB)"
