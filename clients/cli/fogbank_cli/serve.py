"""`fogbank serve`: a server that stays."""

from __future__ import annotations

import os
from pathlib import Path

import click
from fogbank.paths import server_binary

from fogbank_cli.session import Session, pass_session

DEFAULT_ADDRESS = "127.0.0.1:7070"


@click.command()
@click.option("--listen", default=DEFAULT_ADDRESS, show_default=True, help="HOST:PORT (port 0: any) or unix:/path.")
@click.option("--data", type=click.Path(path_type=Path), help="Data directory, as the global option.")
@click.option("--scene-root", type=click.Path(path_type=Path), help="Clients may load scenes below this folder.")
@click.option("--threads", type=click.IntRange(1), help="Worker threads; one per core by default.")
@click.option("--port-file", type=click.Path(path_type=Path), help="Written when the server is ready.")
@pass_session
def serve(
    session: Session,
    /,
    listen: str,
    data: Path | None,
    scene_root: Path | None,
    threads: int | None,
    port_file: Path | None,
) -> None:
    """Run a server in the foreground until SIGINT or SIGTERM."""
    data = data or session.data
    if data is None:
        raise click.UsageError("a server that stays needs a data directory: --data DIR or FOGBANK_DATA")
    command = [str(server_binary()), "--listen", listen, "--data", str(data)]
    for option, value in (("--scene-root", scene_root), ("--threads", threads), ("--port-file", port_file)):
        if value is not None:
            command += [option, str(value)]
    # The server takes this process's place, so that signals and its exit status need no passing on.
    os.execv(command[0], command)
