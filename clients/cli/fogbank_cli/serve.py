"""`fogbank serve`: a server that stays."""

from __future__ import annotations

import os
from pathlib import Path

import click
from fogbank.paths import server_binary

from fogbank_cli.session import Session, pass_session

DEFAULT_ADDRESS = "127.0.0.1:7070"
_SECONDS = click.FloatRange(min=0, min_open=True)
_PEM = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command()
@click.option("--listen", default=DEFAULT_ADDRESS, show_default=True, help="HOST:PORT (port 0: any) or unix:/path.")
@click.option("--data", type=click.Path(path_type=Path), help="Data directory, as the global option.")
@click.option("--scene-root", type=click.Path(path_type=Path), help="Clients may load scenes below this folder.")
@click.option("--threads", type=click.IntRange(1), help="Worker threads; one per core by default.")
@click.option("--memory", type=click.FloatRange(0), metavar="GIB", help="For scenes and films; 3/4 of the machine's.")
@click.option("--metrics", metavar="HOST:PORT", help="On loopback: serves /metrics to Prometheus.")
@click.option("--tls-certificate", type=_PEM, help="Encrypts, on any address, and asks every caller for a token.")
@click.option("--tls-key", type=_PEM, help="The certificate's private key.")
@click.option("--tls-client-ca", type=_PEM, help="Clients with a certificate that it has signed need no token.")
@click.option("--require-tokens", is_flag=True, help="Ask every caller for a token, on loopback and sockets, too.")
@click.option("--insecure-any-address", is_flag=True, help="Listen where others can reach it, without TLS and tokens.")
@click.option("--log-level", type=click.Choice(["debug", "info", "warning", "error", "off"]), help="Default: info.")
@click.option("--log-format", type=click.Choice(["text", "json"]), help="json: an object a line. Default: text.")
@click.option("--trace", type=click.Path(path_type=Path), help="File for the spans of jobs, OTLP/JSON lines.")
@click.option("--task-report", type=_SECONDS, metavar="SECONDS", help="A tile that runs longer is reported.")
@click.option("--task-limit", type=_SECONDS, metavar="SECONDS", help="A tile that runs longer ends its job.")
@click.option("--port-file", type=click.Path(path_type=Path), help="Written when the server is ready.")
@pass_session
def serve(
    session: Session,
    /,
    listen: str,
    data: Path | None,
    scene_root: Path | None,
    threads: int | None,
    memory: float | None,
    metrics: str | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    tls_client_ca: Path | None,
    require_tokens: bool,
    insecure_any_address: bool,
    log_level: str | None,
    log_format: str | None,
    trace: Path | None,
    task_report: float | None,
    task_limit: float | None,
    port_file: Path | None,
) -> None:
    """Run a server in the foreground until SIGINT or SIGTERM."""
    data = data or session.data
    if data is None:
        raise click.UsageError("a server that stays needs a data directory: --data DIR or FOGBANK_DATA")
    command = [str(server_binary()), "--listen", listen, "--data", str(data)]
    options = {
        "--scene-root": scene_root,
        "--threads": threads,
        "--memory": memory,
        "--metrics": metrics,
        "--tls-certificate": tls_certificate,
        "--tls-key": tls_key,
        "--tls-client-ca": tls_client_ca,
        "--log-level": log_level,
        "--log-format": log_format,
        "--trace": trace,
        "--task-report": task_report,
        "--task-limit": task_limit,
        "--port-file": port_file,
    }
    for option, value in options.items():
        if value is not None:
            command += [option, str(value)]
    if require_tokens:
        command.append("--require-tokens")
    if insecure_any_address:
        command.append("--insecure-any-address")
    # The server takes this process's place, so that signals and its exit status need no passing on.
    os.execv(command[0], command)
