"""`fogbank quota`: what each tenant may use of a server."""

from __future__ import annotations

import dataclasses
import re

import click
from fogbank.quotas import EVERYBODY_ELSE, Quota, QuotaFile

from fogbank_cli.output import duration, quantity
from fogbank_cli.session import Session, data_directory, json_option, pass_session
from fogbank_cli.token import LifetimeType

_PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}


class BytesType(click.ParamType[int]):
    """A number of bytes with a decimal prefix: 500M, 20G."""

    name = "bytes"

    def convert(self, value: object, param: click.Parameter | None, context: click.Context | None) -> int:
        """Bytes."""
        match = re.fullmatch(r"([0-9]{1,15})([kMGT]?)B?", str(value))
        if match is None:
            self.fail(f"{value!r} is not like 500M or 20G", param, context)
        return int(int(match[1]) * _PREFIXES[match[2]])


@click.group()
def quota() -> None:
    """Set, list and remove quotas of a server's tenants.

    These commands work on the server's data directory (--data or FOGBANK_DATA), whether it runs or not. A running
    server takes changes within a second. The tenant * is everybody without quotas of their own, and the one user of
    a server that asks nobody who they are.
    """


@quota.command("set")
@click.argument("tenant")
@click.option("--jobs", type=click.IntRange(0), help="Jobs that have not ended.")
@click.option("--stored", "stored_bytes", type=BytesType(), metavar="500M|20G", help="Files and images on the disk.")
@click.option("--cache", "cache_bytes", type=BytesType(), metavar="500M|20G", help="Radiance caches on the disk.")
@click.option("--watchers", type=click.IntRange(0), help="Open streams of WatchJob.")
@click.option("--cpu", "cpu_seconds", type=click.FloatRange(0), help="CPU seconds of render threads in any window.")
@click.option(
    "--window", "window_seconds", type=LifetimeType(), default="1h", show_default=True, help="Length of the window."
)
@json_option
@pass_session
def set_quota(session: Session, /, tenant: str, **values: float | None) -> None:
    """Set all quotas of TENANT; what is not named is what the server's limits allow."""
    made = Quota(**values)  # type: ignore[arg-type]  # click's types are those of the fields
    QuotaFile(data_directory(session, "quota")).set(tenant, made)
    session.output.event("quota", tenant=tenant, **dataclasses.asdict(made))
    session.output.text(f"{tenant}: {_describe(made)}")


@quota.command("ls")
@json_option
@pass_session
def list_quotas(session: Session, /) -> None:
    """List quotas by tenant."""
    rows = []
    for tenant, item in QuotaFile(data_directory(session, "quota")).read().items():
        session.output.event("quota", tenant=tenant, **dataclasses.asdict(item))
        rows.append((tenant, _describe(item)))
    session.output.table(("TENANT", "QUOTAS"), rows)


@quota.command()
@click.argument("tenant")
@json_option
@pass_session
def rm(session: Session, /, tenant: str) -> None:
    """Remove the quotas of TENANT; those of * count for it then."""
    QuotaFile(data_directory(session, "quota")).remove(tenant)
    session.output.event("removed", tenant=tenant)
    rest = "" if tenant == EVERYBODY_ELSE else f"; those of {EVERYBODY_ELSE} count"
    session.output.text(f"{tenant}: removed{rest}")


def _describe(item: Quota) -> str:
    parts = []
    if item.jobs is not None:
        parts.append(f"{item.jobs} jobs")
    if item.stored_bytes is not None:
        parts.append(f"{quantity(item.stored_bytes, 'B')} stored")
    if item.cache_bytes is not None:
        parts.append(f"{quantity(item.cache_bytes, 'B')} of caches")
    if item.watchers is not None:
        parts.append(f"{item.watchers} watchers")
    if item.cpu_seconds is not None:
        parts.append(f"{item.cpu_seconds:.15g} CPU seconds in {duration(item.window_seconds)}")
    return ", ".join(parts) or "none"
