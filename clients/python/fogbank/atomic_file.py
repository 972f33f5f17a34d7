"""Files that appear under their name only when they are whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Writes a file beside `path`, open for reading too, and renames it; an error leaves what was there."""
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(descriptor, "w+b") as file:
                write(file)
                # mkstemp makes private files; a picture gets the permissions of any other new file.
                file_mode_mask = os.umask(0)
                os.umask(file_mode_mask)
                os.fchmod(file.fileno(), 0o666 & ~file_mode_mask)
            Path(temporary).replace(path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        # The user's name for it, not the temporary one.
        error.filename, error.filename2 = str(path), None
        raise
