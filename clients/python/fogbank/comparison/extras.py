"""The packages of the extra `compare`, which the plain client does without."""

from __future__ import annotations

import importlib

_MODULES = ("flip_evaluator", "jinja2", "matplotlib", "pandas", "scipy")


def require_extra() -> None:
    """Raises ModuleNotFoundError, naming the extra, unless its packages are there."""
    for name in _MODULES:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            message = f"{name} is not installed; it comes with pip install 'fogbank[compare]'"
            raise ModuleNotFoundError(message, name=name) from None
