"""`fogbank token`: who may call a server that asks."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import click
from fogbank.tokens import SCOPES, TokenFile

from fogbank_cli.session import Session, data_directory, json_option, pass_session

_UNITS = {"m": 60.0, "h": 3600.0, "d": 86400.0}


class LifetimeType(click.ParamType[float]):
    """A number with a unit: 30m, 12h, 90d; seconds."""

    name = "lifetime"

    def convert(self, value: object, param: click.Parameter | None, context: click.Context | None) -> float:
        """Seconds."""
        match = re.fullmatch(r"([0-9]{1,6})([mhd])", str(value))
        if match is None or int(match[1]) == 0:
            self.fail(f"{value!r} is not like 30m, 12h or 90d", param, context)
        return float(match[1]) * _UNITS[match[2]]


@click.group()
def token() -> None:
    """Make, list and revoke the tokens of a server.

    These commands work on the server's data directory (--data or FOGBANK_DATA), whether it runs or not. A running
    server takes changes within a second.
    """


@token.command()
@click.option("--tenant", required=True, help="Whose it is; tenants see nothing of each other.")
@click.option(
    "--scope",
    "scopes",
    type=click.Choice(SCOPES),
    multiple=True,
    default=("render", "upload"),
    show_default=True,
    help="What it is good for; may be repeated. admin includes the others.",
)
@click.option("--expires", type=LifetimeType(), metavar="30m|12h|90d", help="Ends by itself after this time.")
@json_option
@pass_session
def create(session: Session, /, tenant: str, scopes: tuple[str, ...], expires: float | None) -> None:
    """Make a token and print it; it cannot be shown again."""
    made, text = TokenFile(data_directory(session, "token")).create(tenant, scopes, expires)
    session.output.event("token", id=made.id, tenant=made.tenant, scopes=made.scopes, token=text)
    session.output.text(text)


@token.command("ls")
@json_option
@pass_session
def list_tokens(session: Session, /) -> None:
    """List tokens, oldest first."""
    rows = []
    for item in TokenFile(data_directory(session, "token")).read():
        session.output.event(
            "token",
            id=item.id,
            tenant=item.tenant,
            scopes=item.scopes,
            state=item.state,
            created=item.created,
            expires=item.expires,
            revoked=item.revoked,
        )
        expires = "never" if item.expires is None else _time(item.expires)
        rows.append((item.id, item.tenant, ", ".join(item.scopes), item.state, _time(item.created), expires))
    session.output.table(("TOKEN", "TENANT", "SCOPES", "STATE", "CREATED", "EXPIRES"), rows)


@token.command()
@click.argument("ids", nargs=-1, required=True)
@json_option
@pass_session
def revoke(session: Session, /, ids: tuple[str, ...]) -> None:
    """End the tokens IDS, as `fogbank token ls` shows them, for good."""
    for token_id in ids:
        ended = TokenFile(data_directory(session, "token")).revoke(token_id)
        session.output.event("revoked", id=ended.id, tenant=ended.tenant)
        session.output.text(f"{ended.id}: revoked")


def _time(seconds: int) -> str:
    return f"{datetime.fromtimestamp(seconds, UTC).astimezone():%Y-%m-%d %H:%M}"
