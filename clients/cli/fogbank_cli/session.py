"""What all commands share: the global options, and the way to the server."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ParamSpec, TypeVar

import click
import fogbank

from fogbank_cli.output import Output
from fogbank_cli.parameter_types import AssignmentType

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
Named = TypeVar("Named", fogbank.Scene, fogbank.Job, fogbank.Cache)

# Enough of a fingerprint to be unique in practice; what `ls` prints.
SHORT_ID_LENGTH = 12


@dataclass
class Session:
    """One run of the command."""

    server: str | None = None
    """Address of a running server; None for an embedded one."""

    data: Path | None = None
    """Data directory of the embedded server, or of `fogbank serve`."""

    output: Output = field(default_factory=Output)
    """Where results and events go."""

    def connect(self) -> fogbank.Service:
        """Connects to the server that the global options name, or starts one."""
        if self.server is not None:
            return fogbank.connect(self.server)
        return fogbank.connect(data=self.data)


pass_session = click.make_pass_decorator(Session)


def data_directory(session: Session, command: str) -> Path:
    """The data directory that `command` works on; a usage error where none is named."""
    if session.data is None:
        raise click.UsageError(
            f"which server? Name its data directory: fogbank --data DIR {command} ..., or FOGBANK_DATA"
        )
    return session.data


def folder_option(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--output`, a folder that is made where it isn't there."""
    return click.option(
        "-o",
        "--output",
        "folder",
        type=click.Path(path_type=Path, file_okay=False),
        required=True,
        help="Folder to write to.",
    )(command)


def json_option(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--json`. It is handled first, so that errors in the other options are reported as JSON, too."""

    def remember(context: click.Context, _: click.Parameter, value: bool) -> None:
        if value:
            context.ensure_object(Session).output.as_json = True

    return click.option(
        "--json",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=remember,
        help="Print one JSON object per event on standard output.",
    )(command)


def openjd_option(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--openjd`, handled as early as `--json`."""

    def remember(context: click.Context, _: click.Parameter, value: bool) -> None:
        if value:
            context.ensure_object(Session).output.as_openjd = True

    return click.option(
        "--openjd",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=remember,
        help="Print progress as Open Job Description schedulers read it: openjd_progress, openjd_status, openjd_fail.",
    )(command)


def loading_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what commands that load a scene file have in common: `-D`, `--lenient`, `--root`."""
    for option in (
        click.option(
            "--root",
            type=click.Path(path_type=Path),
            help="Folder with all files of the scene; the scene's own by default.",
        ),
        click.option("--lenient", is_flag=True, help="Substitute what is not supported, with a warning each."),
        click.option("-D", "parameters", type=AssignmentType(), multiple=True, help="Value for $NAME in the scene."),
    ):
        command = option(command)
    return command


def short_id(name: str) -> str:
    """The first digits of a resource's id: "scenes/0123456789abcdef..." -> "0123456789ab"."""
    return name.partition("/")[2][:SHORT_ID_LENGTH]


def find(name: str, collection: str, get: Callable[[str], Named], everything: Iterable[Named]) -> Named:
    """A scene, job or cache by its name, its id, or an unambiguous beginning of its id.

    Args:
        name: as the user typed it.
        collection: "scenes", "jobs" or "caches".
        get: asks the server for an exact name.
        everything: all of the collection.
    """
    identifier = name.removeprefix(f"{collection}/")
    try:
        return get(f"{collection}/{identifier}")
    except (fogbank.NotFoundError, fogbank.InvalidArgumentError) as error:
        matches = [item for item in everything if identifier and item.name.startswith(f"{collection}/{identifier}")]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise click.UsageError(f"{name} is ambiguous: {len(matches)} {collection} begin with it") from None
        if isinstance(error, fogbank.NotFoundError):
            raise
        raise fogbank.NotFoundError(f"there is no {collection}/{identifier}", reason=error.reason) from None
