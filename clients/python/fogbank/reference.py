"""Reference images that jobs report their true error against."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from fogbank.channel import Connection
from fogbank.image import Image
from fogbank.settings import REFERENCE_PREFIX, Reference
from fogbank.upload import upload_file


def upload_reference(connection: Connection, reference: Reference) -> str:
    """What `settings_message` takes for a reference: "sha256:..." of a file that the server holds now.

    Raises OSError when the file cannot be read.
    """
    if isinstance(reference, Image):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "reference.exr"
            path.write_bytes(reference.exr)
            return REFERENCE_PREFIX + upload_file(connection, path)
    if os.fspath(reference).startswith(REFERENCE_PREFIX):
        return os.fspath(reference)
    return REFERENCE_PREFIX + upload_file(connection, Path(reference))
