"""`fogbank reproduce`: the figures and tables of the method, computed anew.

A new figure is a module in `figures` and an entry in FIGURES.
"""

from __future__ import annotations

import click

from fogbank_cli.figures.cache2d import cache2d
from fogbank_cli.figures.gradients import gradients

FIGURES: tuple[click.Command, ...] = (gradients, cache2d)


@click.group()
def reproduce() -> None:
    """Compute the method's figures and tables. Needs the extra `figures` of the package (matplotlib)."""


for figure in FIGURES:
    reproduce.add_command(figure)
