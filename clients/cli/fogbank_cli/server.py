"""`fogbank server`: what a server is and how busy it is."""

from __future__ import annotations

import click

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
    jobs = ", ".join(f"{count} {state}" for state, count in now.jobs.items())
    lines = {
        "jobs": jobs,
        "scenes": f"{now.scenes}, {now.resident_scenes} in memory ({quantity(now.scene_memory_bytes, 'B')})",
        "threads": f"{now.busy_threads} of {now.worker_threads} busy",
        "rays": f"{quantity(now.rays_per_second, 'rays/s')}, {quantity(now.rays, 'rays')} since the start",
        "memory": quantity(now.memory_bytes, "B"),
        "watchers": str(now.watchers),
        "probes": str(now.probes),
    }
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
