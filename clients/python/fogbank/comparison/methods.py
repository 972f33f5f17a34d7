"""Methods by name: integrators of Fogbank, Mitsuba 3, and commands of the user's own."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from fogbank.errors import InvalidArgumentError

Kind = Literal["fogbank", "mitsuba", "command"]

MITSUBA = "mitsuba"
DENOISED = "mitsuba+oidn"
MITSUBA_VARIANT = "llvm_ad_rgb"
_OPTIONS = ("spheres", "minimum_radius", "single_scattering", "rr_depth")


@dataclass(frozen=True)
class Method:
    """Something that renders."""

    name: str
    """As the user wrote it, and as the report calls it."""

    kind: Kind
    """Who runs it."""

    settings: dict[str, Any] = field(default_factory=dict)
    """What its worker is told: integrator and further options, variant, or command."""

    cached: bool = False
    """Whether it makes records."""

    unavailable: str = ""
    """Why it can't be run here; empty when it can."""

    @property
    def file_name(self) -> str:
        """Its name as part of a file's."""
        return "".join(letter if letter.isalnum() or letter in "-+." else "_" for letter in self.name)


def parse_methods(
    names: Sequence[str], integrators: Sequence[str], cached: Sequence[str], adapters: Mapping[str, str]
) -> list[Method]:
    """Methods by their names, in their order.

    Args:
        names: an integrator, perhaps with options ("radiance-cache:spheres+single_scattering=direct"), "mitsuba",
            "mitsuba+oidn", or one of `adapters`.
        integrators: those of the server.
        cached: those of them that make records.
        adapters: command templates by name, see `command_worker`.

    Raises InvalidArgumentError for a name that is none of these; what is merely not installed is marked so.
    """
    found: list[Method] = []
    for name in names:
        base, _, options = name.partition(":")
        if name in adapters:
            method = Method(name, "command", {"command": adapters[name]})
        elif name in (MITSUBA, DENOISED):
            method = Method(
                name,
                "mitsuba",
                {"variant": MITSUBA_VARIANT, "denoise": name == DENOISED},
                unavailable=_missing("mitsuba", *(["pyoidn"] if name == DENOISED else [])),
            )
        elif base in integrators:
            method = Method(name, "fogbank", {"integrator": base, **_parse_options(options)}, cached=base in cached)
        else:
            known = ", ".join([*integrators, MITSUBA, DENOISED, *adapters])
            raise InvalidArgumentError(f"methods: {name!r} is none of {known}", metadata={"field": "methods"})
        if method.file_name in [other.file_name for other in found]:
            raise InvalidArgumentError(f"methods: {name!r} is there twice", metadata={"field": "methods"})
        found.append(method)
    return found


def default_methods(integrators: Sequence[str]) -> list[str]:
    """Everything that there is, the fastest of Fogbank first."""
    first = [name for name in ("radiance-cache", "radiance-cache-unaware", "photon-beams") if name in integrators]
    return [*first, *(name for name in integrators if name not in first), MITSUBA, DENOISED]


def _missing(*modules: str) -> str:
    absent = [name for name in modules if importlib.util.find_spec(name) is None]
    return f"{' and '.join(absent)} not installed" if absent else ""


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidArgumentError(
            f"methods: option {name!r} needs a number, has {text!r}", metadata={"field": "methods"}
        ) from None


def _parse_options(text: str) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for part in filter(None, text.split("+")):
        name, _, value = part.partition("=")
        name = name.replace("-", "_")
        if name not in _OPTIONS:
            raise InvalidArgumentError(
                f"methods: option {name!r} is none of {', '.join(_OPTIONS)}", metadata={"field": "methods"}
            )
        if name == "spheres":
            options[name] = value not in ("0", "false")
        elif name == "rr_depth":
            options[name] = int(value) if value.isdigit() else value
        elif name == "minimum_radius":
            options[name] = _number(name, value)
        else:
            options[name] = value
    return options
