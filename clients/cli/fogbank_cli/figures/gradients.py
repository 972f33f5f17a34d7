"""`fogbank reproduce gradients`: gradients in flatland, exact and as three ways of estimating them see them."""

from __future__ import annotations

from pathlib import Path

import click
from fogbank.flatland import read_scene

from fogbank_cli.figures.gradient_errors import EXPERIMENTS, ErrorRow, markdown, measure_errors, write_csv
from fogbank_cli.figures.scenes import FLATLAND
from fogbank_cli.session import Session, folder_option, json_option, pass_session


@click.command()
@click.option(
    "--order",
    type=click.Choice(["single", "multiple"]),
    default="single",
    show_default=True,
    help="Scattering from lights, or from the fog that they light.",
)
@folder_option
@click.option(
    "--scene",
    "path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="A flatland scene; scenes/flatland/box.json (single) or fog_box.json (multiple) by default.",
)
@click.option("--resolution", type=click.IntRange(4, 512), help="Points a side of the picture; 128 or 48 by default.")
@click.option(
    "--samples", type=click.IntRange(4, 65536), help="Directions a point of the picture; 1024 or 256 by default."
)
@click.option(
    "--table-resolution", type=click.IntRange(4, 256), help="Points a side of the table; 48 or 20 by default."
)
@click.option(
    "--table-samples",
    type=click.IntRange(4, 65536),
    help="The table's most samples; its rows take 64 and fourfold steps up to it. 16384 or 1024 by default.",
)
@json_option
@pass_session
def gradients(
    session: Session,
    /,
    order: str,
    folder: Path,
    path: Path | None,
    resolution: int | None,
    samples: int | None,
    table_resolution: int | None,
    table_samples: int | None,
) -> None:
    """Draw the gradient's orientation and magnitude: exact, occlusion-unaware and aware; tabulate the errors.

    Writes gradients_ORDER.png and gradients_ORDER.csv, and prints the table.
    """
    try:
        from fogbank_cli.figures.gradient_picture import draw
    except ModuleNotFoundError as error:
        raise click.UsageError(f"{error.name} is not installed; it comes with pip install 'fogbank[figures]'") from None
    output = session.output
    experiment = EXPERIMENTS[order]
    scene_path = path or FLATLAND / experiment.scene_file
    scene = read_scene(scene_path)
    picture_samples = samples or experiment.samples
    folder.mkdir(parents=True, exist_ok=True)
    picture, table = (folder / f"gradients_{order}{suffix}" for suffix in (".png", ".csv"))
    with session.connect() as service:
        output.note(f"picture: {scene_path.name}, {picture_samples} directions a point")
        draw(service, scene, experiment, resolution or experiment.resolution, picture_samples, picture)
        output.event("figure", path=picture)
        rows: list[ErrorRow] = []
        for row in measure_errors(
            service,
            scene,
            experiment,
            table_resolution or experiment.table_resolution,
            table_samples or experiment.table_samples,
        ):
            output.note(f"table: {row.samples} directions, {row.method}")
            output.event("errors", **row.fields())
            rows.append(row)
    write_csv(rows, table)
    output.event("done", images=[picture], table=table)
    for line in markdown(rows):
        output.text(line)
    output.text("")
    output.text(f"{picture}, {table}")
