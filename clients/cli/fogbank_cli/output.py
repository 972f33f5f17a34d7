"""What the command prints: text for people, or one JSON object per event."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, is_dataclass
from datetime import datetime
from os import PathLike, fspath
from typing import Any

import click
from fogbank import FogbankError

from fogbank_cli.exit_codes import exit_code


class Output:
    """Where results and events go.

    Attributes:
        as_json: whether `--json` was given: standard output then holds one JSON object a line and nothing else.
        as_openjd: whether `--openjd` was given: standard output then has lines for an Open Job Description scheduler.
    """

    def __init__(self) -> None:
        """Text for people until told otherwise."""
        self.as_json = False
        self.as_openjd = False

    def progress(self, fraction: float, status: str) -> None:
        """Tells a scheduler how far the command is, if `--openjd` was given.

        Args:
            fraction: done, 0 to 1.
            status: what it does, for people.
        """
        if self.as_openjd:
            click.echo(f"openjd_progress: {100.0 * min(max(fraction, 0.0), 1.0):.1f}")
            click.echo(f"openjd_status: {status}")

    def event(self, kind: str, /, **fields: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Prints an event if `--json` was given: {"event": kind, ...}."""
        if self.as_json:
            click.echo(json.dumps({"event": kind, **fields}, default=_plain, allow_nan=False))

    def text(self, line: str) -> None:
        """Prints a result for people, on standard output; nothing with `--json`."""
        if not self.as_json:
            click.echo(line)

    def raw(self, text: str) -> None:
        """Prints a piece of the one JSON document that some commands answer `--json` with, instead of events."""
        click.echo(text, nl=False)

    def note(self, line: str) -> None:
        """Prints a remark for people, on standard error, so that it does not mix with results."""
        click.echo(line, err=True)

    def table(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Prints aligned columns for people."""
        widths = [max(len(row[column]) for row in (header, *rows)) for column in range(len(header))]
        for row in (header, *rows):
            self.text("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())

    def error(self, error: BaseException) -> None:
        """Prints what ended the command."""
        fields: dict[str, Any] = {"message": _message(error), "kind": type(error).__name__}
        if isinstance(error, FogbankError):
            fields |= {"reason": error.reason, "metadata": error.metadata}
            fields["code"] = error.code.name if error.code is not None else ""
        self.event("error", **fields, exit_code=int(exit_code(error)))
        if self.as_openjd:
            click.echo("openjd_fail: " + " ".join(str(fields["message"]).split()))
        if not self.as_json:
            if isinstance(error, click.UsageError):
                error.show()
            else:
                self.note(f"fogbank: error: {fields['message']}")


def _message(error: BaseException) -> str:
    if isinstance(error, click.ClickException):
        return error.format_message()
    if isinstance(error, click.Abort | KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, FogbankError):
        return error.message
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return f"{type(error).__name__}: {error}"


def _plain(value: object) -> Any:  # noqa: ANN401 - whatever JSON can hold
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, PathLike):
        return fspath(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def quantity(value: float, unit: str) -> str:
    """A number with three digits and a decimal prefix: 4.21 Mrays/s."""
    for factor, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"


def duration(seconds: float) -> str:
    """A time span: 0.42 s, 12.3 s, 3 min 05 s, 2 h 07 min."""
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"
