"""`fogbank reproduce cache2d`: a radiance cache in flatland, with and without regard to occlusion."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click
from fogbank.flatland import read_scene

from fogbank_cli.figures.cache2d_errors import Run, make_picture, markdown, sweep, write_csv
from fogbank_cli.figures.scenes import FLATLAND
from fogbank_cli.session import Session, folder_option, json_option, pass_session


@click.command()
@folder_option
@click.option(
    "--scene",
    "path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="A flatland scene; scenes/flatland/box.json by default.",
)
@click.option(
    "--resolution", type=click.IntRange(8, 256), default=128, show_default=True, help="Points a side of the picture."
)
@click.option(
    "--samples", type=click.IntRange(4, 65536), default=1024, show_default=True, help="Directions of a record."
)
@json_option
@pass_session
def cache2d(session: Session, /, folder: Path, path: Path | None, resolution: int, samples: int) -> None:
    """Fill two-dimensional caches at falling thresholds; draw their pictures and tabulate error against records.

    Writes cache2d.png and cache2d.csv, and prints the table.
    """
    try:
        from fogbank_cli.figures.cache2d_picture import draw
    except ModuleNotFoundError as error:
        raise click.UsageError(f"{error.name} is not installed; it comes with pip install 'fogbank[figures]'") from None
    output = session.output
    scene = read_scene(path or FLATLAND / "box.json")
    folder.mkdir(parents=True, exist_ok=True)
    figure, table = folder / "cache2d.png", folder / "cache2d.csv"
    runs: list[Run] = []
    with session.connect() as service:
        picture = make_picture(service, scene, resolution)
        for run in sweep(service, scene, picture, samples):
            output.note(f"{run.row.method}, threshold {run.row.threshold:g}: {run.row.records} records")
            output.event("cache", **asdict(run.row))
            runs.append(run)
    draw(scene, picture, runs, figure)
    output.event("figure", path=figure)
    rows = [run.row for run in runs]
    write_csv(rows, table)
    output.event("done", images=[figure], table=table)
    for line in markdown(rows):
        output.text(line)
    output.text("")
    output.text(f"{figure}, {table}")
