"""`fogbank server`: what a server is and how busy it is."""

from __future__ import annotations

import click
from fogbank import QuotaUse

from fogbank_cli.output import duration, quantity
from fogbank_cli.session import Session, json_option, pass_session


@click.group()
def server() -> None:
    """Ask a server about itself."""


@server.command()
@json_option
@pass_session
def status(session: Session, /) -> None:
    """Show how busy the server is."""
    output = session.output
    with session.connect() as service:
        now = service.status()
        capabilities = service.capabilities
        address = service.address
    output.event("status", address=address, version=capabilities.version, build_id=capabilities.build_id, **vars(now))
    output.text(f"{address}: Fogbank {capabilities.version}, up for {duration(now.uptime_seconds)}")
    held = now.scene_memory_bytes + now.cache_memory_bytes + now.film_memory_bytes
    lines = {
        "jobs": ", ".join(f"{count} {state}" for state, count in now.jobs.items()),
        "scenes": f"{now.scenes}, {now.resident_scenes} in memory",
        "streams": f"{now.watchers} watchers, {now.probes} probes, {now.fills} fills",
        "threads": f"{now.busy_threads} of {now.worker_threads} busy",
        "rays": f"{quantity(now.rays_per_second, 'rays/s')}, {quantity(now.rays, 'rays')} in "
        f"{quantity(now.tiles, 'tiles')} since the start",
        "memory": f"{quantity(now.memory_bytes, 'B')}; of {quantity(now.memory_budget_bytes, 'B')} for data "
        f"{quantity(held, 'B')} in use: scenes {quantity(now.scene_memory_bytes, 'B')}, "
        f"caches {quantity(now.cache_memory_bytes, 'B')}, films {quantity(now.film_memory_bytes, 'B')}",
        "disk": f"{quantity(now.disk_free_bytes, 'B')} free",
        "sandbox": _confinement(now.reader_confinement),
    }
    if now.errors:
        lines["failed"] = ", ".join(f"{count} {reason}" for reason, count in now.errors.items())
    if now.tenant is not None:
        lines["tenant"] = now.tenant
    if now.quotas:
        lines["quotas"] = f"\n{'':12}".join(_quota(name, use) for name, use in now.quotas.items())
    for label, text in lines.items():
        output.text(f"  {label:<10}{text}")


@server.command()
@json_option
@pass_session
def capabilities(session: Session, /) -> None:
    """Show what the server can do, and its limits."""
    output = session.output
    with session.connect() as service:
        what = service.capabilities
    output.event("capabilities", **vars(what))
    output.text(f"Fogbank {what.version}, build {what.build_id}")
    output.text("integrators:")
    for name, description in what.integrators.items():
        output.text(f"  {name}: {description}")
    output.text("probe methods:")
    for name, description in what.probe_methods.items():
        output.text(f"  {name}: {description}")
    output.text("scene plugins:")
    for kind, names in what.scene_plugins.items():
        output.text(f"  {kind}: {', '.join(names)}")
    output.text("limits:")
    for name, limit in what.limits.items():
        output.text(f"  {name}: {limit.value:.15g} {limit.unit} ({limit.description})")


def _confinement(layers: dict[str, str | None]) -> str:
    if not layers:
        return "unknown: no process that reads scene files has been started yet"
    in_force = ", ".join(name for name, problem in layers.items() if problem is None) or "nothing"
    missing = "".join(f"; no {name}: {problem}" for name, problem in layers.items() if problem is not None)
    return f"processes that read scene files are confined by {in_force}{missing}"


def _quota(name: str, use: QuotaUse) -> str:
    unit = {"bytes": "B", "seconds": "s"}.get(use.unit, "")
    text = f"{name} {quantity(use.used, unit).strip()} of {quantity(use.limit, unit).strip()}"
    if use.window_seconds:
        text += f" in {duration(use.window_seconds)}"
    return f"{text}, exhausted: retry in {duration(use.retry_after_seconds)}" if use.retry_after_seconds else text
