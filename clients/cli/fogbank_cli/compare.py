"""`fogbank compare`: error against run time, method by method."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click
import fogbank
from fogbank.comparison import BUDGETS, SEEDS

from fogbank_cli.comparison_progress import ComparisonBar
from fogbank_cli.parameter_types import (
    AssignmentType,
    DurationType,
    NumbersType,
    SizeInBytesType,
    SizeType,
    WindowType,
)
from fogbank_cli.session import Session, folder_option, json_option, pass_session

if TYPE_CHECKING:
    from fogbank.comparison.comparison import Comparison


@click.command()
@click.argument("scene", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@folder_option
@click.option(
    "--methods",
    metavar="NAME,...",
    help="Integrators, with options as in radiance-cache:spheres+single_scattering=direct; mitsuba; mitsuba+oidn; those"
    " of --adapter. All by default, without options.",
)
@click.option(
    "--budgets",
    type=NumbersType(),
    default=BUDGETS,
    show_default=",".join(f"{budget:g}" for budget in BUDGETS),
    help="Seconds of rendering, or records with --equal records.",
)
@click.option("--seeds", type=click.IntRange(1), default=SEEDS, show_default=True, help="Pictures of each budget.")
@click.option(
    "--equal",
    type=click.Choice(["time", "records"]),
    default="time",
    show_default=True,
    help="What methods have the same of; records: for methods with a cache.",
)
@click.option("--spp", type=click.IntRange(1), help="Samples per pixel with --equal records; the scene's by default.")
@click.option(
    "--reference",
    type=click.Path(path_type=Path, dir_okay=False),
    help=".exr to measure against; halves NAME_a.exr and NAME_b.exr beside it are used.",
)
@click.option(
    "--make-reference", type=DurationType(), help="Make one, in this time; the default, 20 times the largest budget."
)
@click.option("--size", type=SizeType(), help="Of the film in pixels; the reference's or the scene's by default.")
@click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit; the scene's by default.")
@click.option("--inset", "insets", type=WindowType(), multiple=True, help="Window to enlarge; may be repeated.")
@click.option(
    "--adapter",
    "adapters",
    type=AssignmentType(),
    multiple=True,
    metavar="NAME=COMMAND",
    help="A renderer of your own, see clients/README.md; may be repeated.",
)
@click.option("-D", "parameters", type=AssignmentType(), multiple=True, help="Value for $NAME in the scene.")
@click.option("--threads", type=click.IntRange(1), help="Of every method; one per core by default.")
@click.option(
    "--memory", type=SizeInBytesType(), help="Most memory of a method, e.g. 8G; 4/5 of the machine's by default."
)
@json_option
@pass_session
def compare(
    session: Session,
    /,
    scene: Path,
    folder: Path,
    methods: str | None,
    budgets: tuple[float, ...],
    seeds: int,
    equal: Literal["time", "records"],
    spp: int | None,
    reference: Path | None,
    make_reference: float | None,
    size: tuple[int | None, int | None] | None,
    max_depth: int | None,
    insets: tuple[fogbank.Window, ...],
    adapters: tuple[tuple[str, str], ...],
    parameters: tuple[tuple[str, str], ...],
    threads: int | None,
    memory: int | None,
) -> None:
    """Render SCENE with several methods, equally long, and report their errors.

    Writes report.html, which holds everything it shows, results.csv, plots, pictures and EXRs. Every method has a
    process of its own, and a server of its own where it needs one; caches begin empty. Pictures that are there are not
    made again: after an interruption the same command goes on.
    """
    if session.server is not None:
        raise click.UsageError("compare starts servers of its own; leave out --server")
    output = session.output
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    try:
        with ComparisonBar(output) as bar:
            found = fogbank.compare(
                scene,
                folder,
                methods=names,
                budgets=budgets,
                seeds=seeds,
                equal=equal,
                spp=spp,
                reference=reference,
                make_reference=make_reference,
                size=size,
                max_depth=max_depth,
                parameters=dict(parameters),
                adapters=dict(adapters),
                insets=insets or None,
                threads=threads,
                memory_bytes=memory,
                command=shlex.join(["fogbank", *sys.argv[1:]]),
                on_progress=bar.progress,
            )
    except ModuleNotFoundError as error:
        raise click.UsageError(str(error)) from None
    except KeyboardInterrupt:
        output.note(f"the same command goes on with what {folder} holds")
        raise
    for row in found.table.to_dict("records"):
        output.event("picture", **{str(name): None if value != value else value for name, value in row.items()})
    failed = found.table[found.table["status"] != "done"]
    for (method, status, message), group in failed.groupby(["method", "status", "message"], sort=False):
        output.note(f"{method}: {len(group)} pictures {status}: {message}")
    for line in markdown(found):
        output.text(line)
    output.event("done", report=found.report, table=found.folder / "results.csv")
    output.text("")
    output.text(str(found.report))


def markdown(comparison: Comparison) -> list[str]:
    """Means over the seeds, as a table."""
    lines = [
        "| method | budget | CPU s | wall s | records | relative MSE | FLIP |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in comparison.summary.to_dict("records"):
        records = "" if row["records"] != row["records"] else f"{row['records']:.0f}"
        lines.append(
            f"| {row['method']} | {row['budget']:g} | {row['cpu_seconds']:.2f} | {row['wall_seconds']:.2f} | {records}"
            f" | {row['trimmed']:.2g} | {row['flip']:.3f} |"
        )
    return lines
