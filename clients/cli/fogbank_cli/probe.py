"""`fogbank probe`: radiance at points, with gradient and Hessian."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import click
import fogbank
import numpy as np
from fogbank import ProbeOptions, ProbeResult

from fogbank_cli.output import Output
from fogbank_cli.parameter_types import PointType
from fogbank_cli.render import note_warnings
from fogbank_cli.session import Session, json_option, loading_options, pass_session

Point = tuple[float, float, float]

# So many points are shown with all their numbers; of more there is a line for each.
_MOST_POINTS_IN_FULL = 4

_FIELDS = ("radiance", "gradient", "hessian", "luminance", "luminance_gradient", "luminance_hessian")


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--at", "at", type=PointType(), multiple=True, help="A point in scene units; may be repeated.")
@click.option(
    "--points",
    "points_path",
    type=click.Path(path_type=Path),
    help='JSON file of more points: {"points": [[x, y, z], ...]}.',
)
@click.option("--method", help="aware (the default), unaware, finite-difference: `fogbank server capabilities`.")
@click.option(
    "--order",
    type=click.Choice(["single", "multiple", "both"]),
    help="Light that comes from surfaces and emitters, from the medium, or both (the default).",
)
@click.option(
    "--derivatives",
    type=click.Choice(["value", "gradient", "hessian"]),
    help="Up to which order; hessian by default.",
)
@click.option("--samples", type=int, help="Directions of one estimate; 1024 by default.")
@click.option("--repeats", type=int, help="Estimates to average; their spread is the standard error. 4 by default.")
@click.option("--max-depth", type=int, help="Greatest path length in edges, -1 for no limit; the scene's by default.")
@click.option("--bisect/--no-bisect", default=None, help="Refine silhouettes by bisection; on by default.")
@click.option("--sliding/--no-sliding", default=None, help="Hessian: outlines that slide; on by default.")
@click.option("--corners/--no-corners", default=None, help="Hessian: outlines that cross; on by default.")
@click.option("--seed", type=click.IntRange(0, 2**64 - 1), help="Of the random numbers; 0 by default.")
@loading_options
@json_option
@pass_session
def probe(
    session: Session,
    /,
    scene: Path,
    at: tuple[Point, ...],
    points_path: Path | None,
    method: str | None,
    order: Literal["single", "multiple", "both"] | None,
    derivatives: Literal["value", "gradient", "hessian"] | None,
    samples: int | None,
    repeats: int | None,
    max_depth: int | None,
    bisect: bool | None,
    sliding: bool | None,
    corners: bool | None,
    seed: int | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
) -> None:
    """Mean incoming radiance (fluence / 4 pi) at points of SCENE, with gradient and Hessian.

    Points may lie anywhere; those of --at come first, then those of --points. Radiance is linear Rec. 709, gradients
    are per scene unit, Hessians per scene unit squared. Every number comes with its standard error. With --json
    standard output holds one object, {"points": [...]}, of a line for each point.
    """
    points = [*at, *(read_points(points_path) if points_path is not None else ())]
    if not points:
        raise click.UsageError("no points: name some with --at or --points")
    options: ProbeOptions = {
        "method": method,
        "order": order,
        "derivatives": derivatives,
        "samples": samples,
        "repeats": repeats,
        "max_depth": max_depth,
        "bisect": bisect,
        "sliding": sliding,
        "corners": corners,
        "seed": seed,
    }
    output = session.output
    with session.connect() as service:
        loaded = service.load(scene, parameters=dict(parameters), lenient=lenient, root=root)
        note_warnings(loaded, output)
        results = loaded.probe_stream([np.array(points)], **options)
        if output.as_json:
            _print_json(output, results)
        elif len(points) <= _MOST_POINTS_IN_FULL:
            for result in results:
                _print_in_full(output, result)
        else:
            _print_table(output, results)


def read_points(path: Path) -> list[Point]:
    """The points of a file {"points": [[x, y, z], ...]}.

    Raises click.UsageError, naming file and element, for anything else, and OSError when it cannot be read.
    """

    def refuse(what: str) -> click.UsageError:
        return click.UsageError(f"{path}: {what}")

    try:
        document = json.loads(path.read_bytes())
    except json.JSONDecodeError as error:
        raise refuse(f"line {error.lineno}, column {error.colno}: {error.msg}") from None
    except UnicodeDecodeError as error:
        raise refuse(f"is no text: {error.reason}") from None
    if not isinstance(document, dict) or not isinstance(document.get("points"), list):
        raise refuse('must hold an object {"points": [[x, y, z], ...]}')
    if unknown := sorted(set(document) - {"points"}):
        raise refuse(f"unknown key {unknown[0]!r}; only points is known")
    points = []
    for index, element in enumerate(document["points"]):
        if not isinstance(element, list) or len(element) != 3 or not all(map(_is_number, element)):
            raise refuse(f"points[{index}]: {json.dumps(element)} is not [x, y, z], three finite numbers")
        x, y, z = map(float, element)
        points.append((x, y, z))
    return points


def _is_number(value: object) -> bool:
    # Python's reader also takes NaN and Infinity, and integers that exceed a float.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _print_json(output: Output, results: Iterator[ProbeResult]) -> None:
    """One object, written as the results arrive, so that millions of points need little memory."""
    first = True
    for result in results:
        for point in _objects(result):
            output.raw(('{"points": [\n' if first else ",\n") + json.dumps(point, allow_nan=False))
            first = False
    output.raw("\n]}\n")


def _objects(result: ProbeResult) -> Iterator[dict[str, Any]]:
    mean, error = _lists(result), _lists(result.standard_error)
    for i in range(len(result)):
        yield {
            "position": result.position[i].tolist(),
            **{name: mean[name] and mean[name][i] for name in _FIELDS},
            "standard_error": {name: error[name] and error[name][i] for name in _FIELDS},
            "samples": int(result.samples[i]),
            "seconds": float(result.seconds[i]),
        }


def _lists(field: fogbank.ProbeField) -> dict[str, Any]:
    """The arrays as lists; None for what was not computed."""
    return {name: field.arrays[name].tolist() if name in field.arrays else None for name in _FIELDS}


def _medium(result: ProbeResult, i: int) -> str:
    index = int(result.medium[i])
    return "-" if index < 0 else result.media[index] or f"#{index}"


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:>11.4g}" for value in values)


def _print_in_full(output: Output, result: ProbeResult) -> None:
    """Every number of every point, each row followed by its standard error."""
    mean, error = result.arrays, result.standard_error.arrays
    for i in range(len(result)):
        x, y, z = result.position[i]
        output.text(
            f"({x:g}, {y:g}, {z:g}): medium {_medium(result, i)},"
            f" {result.samples[i]} rays, {1e3 * result.seconds[i]:.3g} ms"
        )

        def row(label: str, name: str, *index: int, i: int = i) -> None:
            values = np.atleast_1d(mean[name][(i, *index)]).ravel()
            errors = np.atleast_1d(error[name][(i, *index)]).ravel()
            output.text(f"  {label:<20}{_numbers(values.tolist()):<36}  +- {_numbers(errors.tolist())}")

        row("radiance r g b", "radiance")
        row("luminance", "luminance")
        for prefix, letters in (("luminance_", ("luminance",)), ("", ("r", "g", "b"))):
            for channel, letter in enumerate(letters):
                index = () if prefix else (channel,)
                if f"{prefix}gradient" in mean:
                    row(f"gradient {letter}", f"{prefix}gradient", *index)
                if f"{prefix}hessian" in mean:
                    for axis, direction in enumerate("xyz"):
                        label = f"hessian {letter}" if axis == 0 else ""
                        row(f"{label:<18}{direction}", f"{prefix}hessian", *index, axis)


def _print_table(output: Output, results: Iterator[ProbeResult]) -> None:
    """One line a point, as the results arrive, of luminance alone."""
    columns = [("X", 11), ("Y", 11), ("Z", 11), ("LUMINANCE", 11), ("+-", 9)]
    columns += [("D/DX", 11), ("D/DY", 11), ("D/DZ", 11), ("+-", 9), ("|HESSIAN|", 11), ("+-", 9)]
    columns += [("RAYS", 9), ("MS", 8)]
    output.text(" ".join(f"{name:>{width}}" for name, width in columns) + "  MEDIUM")
    for result in results:
        mean, error = result.arrays, result.standard_error.arrays
        for i in range(len(result)):
            cells: list[float | None] = [*result.position[i], mean["luminance"][i], error["luminance"][i]]
            if "luminance_gradient" in mean:
                cells += [*mean["luminance_gradient"][i], float(np.linalg.norm(error["luminance_gradient"][i]))]
            else:
                cells += [None] * 4
            if "luminance_hessian" in mean:
                cells += [float(np.linalg.norm(field["luminance_hessian"][i])) for field in (mean, error)]
            else:
                cells += [None] * 2
            cells += [float(result.samples[i]), 1e3 * float(result.seconds[i])]
            texts = ("" if cell is None else f"{cell:.4g}" for cell in cells)
            line = " ".join(f"{text:>{width}}" for text, (_, width) in zip(texts, columns, strict=True))
            output.text(f"{line}  {_medium(result, i)}")
