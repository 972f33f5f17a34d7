"""JSON files in a server's data directory that the operator changes and the server reads again."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from fogbank.atomic_file import write_atomically
from fogbank.errors import InvalidArgumentError

_VERSION = 1


class DataFile:
    """One such file: an object with "version" and one more key. The server need not run."""

    def __init__(self, path: Path, key: str) -> None:
        """Neither reads nor writes yet."""
        self.path = path
        self._key = key

    def read(self) -> Any:  # noqa: ANN401 - whatever JSON can hold
        """What stands under the key; None without a file. InvalidArgumentError for a file that is none of ours."""
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
            if content["version"] != _VERSION:
                raise ValueError(f"it is of version {content['version']}")
            return content[self._key]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidArgumentError(f"{self.path}: {error}") from None

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Nobody else changes the file meanwhile."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.path.with_suffix(".lock"), os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield
        finally:
            os.close(descriptor)

    def write(self, value: object) -> None:
        """Replaces what stands under the key; on the disk when it returns."""
        content: Mapping[str, object] = {"version": _VERSION, self._key: value}
        data = json.dumps(content, indent=1).encode()

        def write(file: BinaryIO) -> None:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())  # what was revoked stays so

        write_atomically(self.path, write)
