"""`fogbank sweep`: frames along a camera path, from one cache."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import click
from fogbank import RenderOptions

from fogbank_cli.parameter_types import Bands, RangeType
from fogbank_cli.render_options import part_options, take_part
from fogbank_cli.session import Session, json_option, openjd_option, pass_session
from fogbank_cli.sweep_frames import SweepChoice, render_sweep, sweep_options


@click.command()
@sweep_options
@click.option("--only", type=RangeType(), help="Render frames A to B alone, counted from 0; records are made for all.")
@part_options
@openjd_option
@json_option
@pass_session
def sweep(
    session: Session,
    /,
    choice: SweepChoice,
    only: tuple[int, int] | None,
    bands: Bands | None,
    cache_file: Path | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Render SCENE along a camera path, and write a numbered image for each frame.

    Records are made in the order of the frames, and no frame depends on when it is rendered. With --fill first those of
    all frames are made first, and every frame is rendered at that one epoch of the cache, so that the sequence does not
    flicker while records are added. With --fill ahead a frame is rendered as soon as it has its records, while those of
    later frames are made. Frames are whole or not there: after an interruption --resume makes the missing ones, the
    same to the bit.
    """
    with session.connect() as service:
        loaded = choice.load(service, session.output)
        take_part(loaded, bands, options)
        if cache_file is not None:
            loaded.cache.import_(cache_file)
        render_sweep(
            choice,
            loaded,
            service,
            session.output,
            options,
            start=lambda frame: loaded.render(**frame),
            fill_events=loaded.cache.fill_events,
            only=only,
        )
