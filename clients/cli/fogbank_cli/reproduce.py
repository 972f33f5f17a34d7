"""`fogbank reproduce`: the figures and tables of the method, computed anew.

A new figure is a module in `figures` and an entry in FIGURES.
"""

from __future__ import annotations

import click

from fogbank_cli.figures.cache2d import cache2d
from fogbank_cli.figures.gradients import gradients
from fogbank_cli.figures.talk import staircase, statues

FIGURES: tuple[click.Command, ...] = (gradients, cache2d, statues, staircase)


@click.group()
def reproduce() -> None:
    """Compute the method's figures and tables. Needs the extras `figures` and `compare` of the package."""


for figure in FIGURES:
    reproduce.add_command(figure)
