"""The command `fogbank`.

Click does the parsing: nested commands compose from separate modules, values have types, options may come from the
environment, and commands can be called from tests. A new noun or verb is a module and one entry in COMMANDS.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import click
from fogbank import FogbankError

from fogbank_cli.cache import cache
from fogbank_cli.compare import compare
from fogbank_cli.exit_codes import ExitCode, exit_code, help_table
from fogbank_cli.farm import farm
from fogbank_cli.job import job
from fogbank_cli.join import join
from fogbank_cli.openjd import openjd
from fogbank_cli.plan import plan
from fogbank_cli.probe import probe
from fogbank_cli.quota import quota
from fogbank_cli.reference import reference
from fogbank_cli.render import render
from fogbank_cli.reproduce import reproduce
from fogbank_cli.scene import scene
from fogbank_cli.serve import serve
from fogbank_cli.server import server
from fogbank_cli.session import Session
from fogbank_cli.sweep import sweep
from fogbank_cli.tls import tls
from fogbank_cli.token import token

COMMANDS: tuple[click.Command, ...] = (
    render,
    sweep,
    farm,
    join,
    openjd,
    probe,
    plan,
    serve,
    scene,
    job,
    cache,
    server,
    token,
    quota,
    tls,
    compare,
    reference,
    reproduce,
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=help_table())
@click.option("--server", "address", envvar="FOGBANK_SERVER", help="HOST:PORT or unix:/path of a running server.")
@click.option(
    "--data",
    envvar="FOGBANK_DATA",
    type=click.Path(path_type=Path),
    help="Data directory of the embedded server; in the user's cache folder by default.",
)
@click.version_option(package_name="fogbank")
@click.pass_context
def fogbank(context: click.Context, address: str | None, data: Path | None) -> None:
    """Render scenes in fog. Without --server a server is started for the command and ends with it."""
    session = context.ensure_object(Session)
    session.server = address
    session.data = data


for command in COMMANDS:
    fogbank.add_command(command)


def run(arguments: Sequence[str]) -> int:
    """Runs the command and returns its exit status; errors are printed, never raised."""
    try:
        return _run(arguments)
    except BrokenPipeError:
        # Whoever read the output has gone (`| head`). Python must not try to write the rest when it ends.
        # Status 1 is what click makes of this while a command runs; here an error was to be reported.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.INTERNAL


def _run(arguments: Sequence[str]) -> int:
    session = Session()
    try:
        fogbank.main(args=list(arguments), prog_name="fogbank", standalone_mode=False, obj=session)
    except BrokenPipeError:
        raise
    except (click.ClickException, click.Abort, FogbankError, OSError, KeyboardInterrupt) as error:
        session.output.error(error)
        return exit_code(error)
    return ExitCode.OK


def main() -> None:
    """Entry point of the command."""
    sys.exit(run(sys.argv[1:]))
