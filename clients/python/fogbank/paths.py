"""Where this package keeps and finds things on the user's machine."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from fogbank.errors import ServerStartError

BINARY_VARIABLE = "FOGBANK_SERVER_BINARY"
DATA_VARIABLE = "FOGBANK_DATA"
_BINARY_NAME = "fogbankd"


def cache_folder() -> Path:
    """The user's cache folder for Fogbank: $XDG_CACHE_HOME/fogbank, else ~/.cache/fogbank."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "fogbank"


def server_binary() -> Path:
    """The server program: $FOGBANK_SERVER_BINARY, else the release build of the checkout, else the one on the PATH.

    Raises ServerStartError, naming the places looked at, when there is none.
    """
    named = os.environ.get(BINARY_VARIABLE)
    if named:
        if os.access(named, os.X_OK):
            return Path(named)
        raise ServerStartError(f"{BINARY_VARIABLE} names {named}, which is not an executable file")
    # clients/python/fogbank/paths.py -> the checkout; elsewhere when installed from a wheel, and then absent.
    built = Path(__file__).resolve().parents[3] / "build" / "release" / "bin" / _BINARY_NAME
    if os.access(built, os.X_OK):
        return built
    installed = shutil.which(_BINARY_NAME)
    if installed is not None:
        return Path(installed)
    raise ServerStartError(
        f"no server program: {BINARY_VARIABLE} is not set, {built} does not exist (`make build` makes it), and there"
        f" is no {_BINARY_NAME} on the PATH"
    )
