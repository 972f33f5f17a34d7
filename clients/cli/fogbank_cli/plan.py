"""`fogbank plan`: what a scene needs, what is left out, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from fogbank_cli.render import note_warnings
from fogbank_cli.session import Session, json_option, loading_options, pass_session


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "--order",
    type=click.Choice(["single", "multiple", "both"]),
    help="Light that comes from surfaces and emitters, from the medium, or both (the default).",
)
@click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit; the scene's by default.")
@loading_options
@json_option
@pass_session
def plan(
    session: Session,
    /,
    scene: Path,
    order: Literal["single", "multiple", "both"] | None,
    max_depth: int | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
) -> None:
    """Show which terms of light transport records of SCENE need, which are left out, and why.

    The last lines say of which lights its picture, with an empty cache, would cache single scattering.
    """
    output = session.output
    with session.connect() as service:
        loaded = service.load(scene, parameters=dict(parameters), lenient=lenient, root=root)
        note_warnings(loaded, output)
        terms = loaded.plan(order=order, max_depth=max_depth)
    output.event("plan", scene=loaded.name, main_path=loaded.main_path, terms=terms)
    output.table(("TERM", "", "WHY"), [(term.term, "on" if term.on else "off", term.reason) for term in terms])
