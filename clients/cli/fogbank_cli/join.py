"""`fogbank join`: parts of a picture, put together."""

from __future__ import annotations

import glob
from pathlib import Path

import click
from fogbank.image_join import join_images

from fogbank_cli.image_output import exposure_option
from fogbank_cli.session import Session, json_option, openjd_option, pass_session


@click.command()
@click.argument("patterns", metavar="PART...", nargs=-1, required=True)
@click.option("-o", "--output", "result", metavar="FILE", required=True, help=".exr or .png of the whole picture.")
@click.option("--frame", type=click.IntRange(0), help="Number that stands for %d or %04d in the names.")
@exposure_option
@openjd_option
@json_option
@pass_session
def join(session: Session, /, patterns: tuple[str, ...], result: str, frame: int | None, exposure: float) -> None:
    """Put PARTS of a picture together, .exr files of `fogbank render --crop` or --bands; patterns with * are expanded.

    The result has the pixels of the picture made in one piece, bit for bit. Parts of different pictures are refused,
    and so are parts that differ where they overlap or leave something out.
    """
    output = session.output
    try:
        names = [pattern if frame is None else pattern % frame for pattern in patterns]
        target = Path(result if frame is None else result % frame)
    except (TypeError, ValueError):
        raise click.UsageError("with --frame every name has one %d or the like") from None
    paths: list[Path] = []
    for name in names:
        found = sorted(map(Path, glob.glob(name)))  # noqa: PTH207 - names may be absolute
        if not found:
            raise click.UsageError(f"there is no file {name}")
        paths += found
    image = join_images({str(path): path.read_bytes() for path in paths})
    image.save(target, exposure=exposure)
    output.progress(1.0, f"joined {len(paths)} parts")
    output.event("done", image=target, parts=paths, film_size=image.film_size)
    output.text(f"{target}: {image.film_size[0]}x{image.film_size[1]} from {len(paths)} parts")
