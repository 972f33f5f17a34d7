"""The packages of the extra `farm`, which the plain client does without."""

from __future__ import annotations

import importlib


def require_extra() -> None:
    """Raises ModuleNotFoundError, naming the extra, unless its packages are there."""
    require_package("distributed", "pip install 'fogbank[farm]'")


def require_package(name: str, command: str) -> None:
    """Raises ModuleNotFoundError, saying by which `command` the package comes, unless it is there."""
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        raise ModuleNotFoundError(f"{name} is not installed; it comes with {command}", name=name) from None
