"""`fogbank reproduce`: the figures and tables of the method, computed anew.

A new figure is a module in `figures` and an entry in FIGURES.
"""

from __future__ import annotations

import click

from fogbank_cli.figures.gradients import gradients

FIGURES: tuple[click.Command, ...] = (gradients,)


@click.group()
def reproduce() -> None:
    """Compute the method's figures and tables. Needs the extra `figures` of the package (matplotlib)."""


for figure in FIGURES:
    reproduce.add_command(figure)
