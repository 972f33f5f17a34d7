"""`fogbank tls`: certificates for servers that others can reach, by an authority of one's own."""

from __future__ import annotations

from pathlib import Path

import click
from fogbank.certificates import CertificateFiles, issue_client, issue_farm, issue_server, make_authority
from fogbank.tokens import TENANT_NAME

from fogbank_cli.session import Session, json_option, pass_session

_folder_argument = click.argument("folder", type=click.Path(file_okay=False, path_type=Path))


@click.group()
def tls() -> None:
    """Make an authority and certificates. Clients trust FOLDER/ca.pem (FOGBANK_CA); ca.key is to be kept safe."""


@tls.command()
@_folder_argument
@click.option(
    "--host", "hosts", multiple=True, required=True, help="Name or address that clients know the server by; may repeat."
)
@json_option
@pass_session
def init(session: Session, /, folder: Path, hosts: tuple[str, ...]) -> None:
    """Make an authority in FOLDER, and a certificate for a server."""
    _report(session, "authority", make_authority(folder))
    _report(session, "server", issue_server(folder, hosts))


@tls.command()
@_folder_argument
@click.option("--host", "hosts", multiple=True, required=True, help="As for `init`.")
@json_option
@pass_session
def renew(session: Session, /, folder: Path, hosts: tuple[str, ...]) -> None:
    """Replace the server's certificate; a running server takes the new one within seconds."""
    _report(session, "server", issue_server(folder, hosts))


@tls.command()
@_folder_argument
@click.argument("tenant")
@json_option
@pass_session
def worker(session: Session, /, folder: Path, tenant: str) -> None:
    """Make a certificate with which a worker of TENANT needs no token (fogbankd --tls-client-ca FOLDER/ca.pem)."""
    if not TENANT_NAME.fullmatch(tenant):
        raise click.UsageError(f"{tenant!r} is not a tenant: 1 to 32 characters of [a-z0-9-], not - first")
    if tenant in ("ca", "server"):
        raise click.UsageError(f"{tenant!r} is taken: FOLDER/{tenant}.pem is something else")
    if (folder / "dask.pem").exists():
        raise click.UsageError(f"{folder} is a farm's: whoever has a certificate of it may run programs there")
    _report(session, "worker", issue_client(folder, tenant))


@tls.command()
@_folder_argument
@json_option
@pass_session
def farm(session: Session, /, folder: Path) -> None:
    """Make FOLDER/dask.pem, by which scheduler, workers and clients of a farm know each other, or replace it.

    Whoever has dask.key may run programs on every worker. FOLDER gets an authority of its own, since any certificate of
    that authority opens the farm.
    """
    if (folder / "server.pem").exists():
        raise click.UsageError(f"{folder} is a server's: clients with its certificates could run programs on the farm")
    if not (folder / "ca.pem").exists():
        _report(session, "authority", make_authority(folder))
    _report(session, "farm", issue_farm(folder))


def _report(session: Session, kind: str, files: CertificateFiles) -> None:
    session.output.event(kind, certificate=files.certificate, key=files.key)
    session.output.text(f"{kind}: {files.certificate}, {files.key}")
