"""`fogbank reference`: what pictures are measured against."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click
from fogbank.comparison.extras import require_extra

from fogbank_cli.comparison_progress import ComparisonBar
from fogbank_cli.output import duration
from fogbank_cli.parameter_types import AssignmentType, DurationType, SizeType
from fogbank_cli.session import Session, json_option, pass_session


@click.command()
@click.argument("scene", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option(
    "-o",
    "--output",
    "path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="NAME.exr; the halves go into NAME_a.exr and NAME_b.exr.",
)
@click.option("--time", "seconds", type=DurationType(), required=True, help="Of rendering in all, e.g. 90, 30m or 2h.")
@click.option(
    "--error",
    type=click.FloatRange(0.0, min_open=True),
    metavar="RELATIVE",
    help="End earlier, when noise leaves no greater relative error (root mean square), e.g. 0.01.",
)
@click.option("--size", type=SizeType(), help="Of the film, in pixels; the scene's by default.")
@click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit; the scene's by default.")
@click.option("-D", "parameters", type=AssignmentType(), multiple=True, help="Value for $NAME in the scene.")
@click.option("--threads", type=click.IntRange(1), help="Most threads at work.")
@json_option
@pass_session
def reference(
    session: Session,
    /,
    scene: Path,
    path: Path,
    seconds: float,
    error: float | None,
    size: tuple[int | None, int | None] | None,
    max_depth: int | None,
    parameters: tuple[tuple[str, str], ...],
    threads: int | None,
) -> None:
    """Render two independent halves of SCENE by path tracing, and their mean, until little noise is left.

    The halves' difference says how much; the residual error stands in the header of NAME.exr. The filter is box, as
    `fogbank compare` needs it. Rounds that are there count: after an interruption the same command goes on, and
    a longer --time makes the reference better.
    """
    try:
        require_extra()
    except ModuleNotFoundError as absence:
        raise click.UsageError(str(absence)) from None
    from fogbank.comparison.references import ReferenceState, make_reference
    from fogbank.comparison.runner import ComparisonProgress
    from fogbank.comparison.scene_text import choose_size, prepare_scene

    if path.suffix.lower() != ".exr":
        raise click.UsageError(f"{path}: a reference is an .exr")
    output = session.output
    values = dict(parameters)
    with ComparisonBar(output) as bar, session.connect() as service, tempfile.TemporaryDirectory() as folder:
        chosen = choose_size(scene, values, size)
        loaded = service.load(prepare_scene(scene, Path(folder), chosen, values))

        def tell(state: ReferenceState) -> None:
            doing = f"{state.samples_per_pixel} samples, residual error {100.0 * (state.residual or 0.0):.2g} %"
            left = max(seconds - state.seconds, 0.0)
            bar.progress(ComparisonProgress(doing, min(state.seconds / seconds, 1.0), left))

        state = make_reference(
            loaded, path, seconds=seconds, error=error, max_depth=max_depth, threads=threads, on_progress=tell
        )
    output.event("done", image=path, **vars(state))
    output.text(
        f"{path}: {state.size[0]}x{state.size[1]}, {state.samples_per_pixel} spp in {duration(state.seconds)},"
        f" residual error {100.0 * (state.residual or 0.0):.2g} %"
    )
