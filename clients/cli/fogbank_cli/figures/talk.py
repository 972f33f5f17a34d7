"""`fogbank reproduce statues` and `staircase`: the comparisons that the method's authors showed, in our scenes.

Theirs: path tracing, progressive photon beams, a cache with derivatives that don't see occlusion and one with those
that do, at equal time, error and records; records in ellipsoids instead of spheres; and what the derivatives cost.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ParamSpec, TypeVar

import click
import fogbank
from fogbank.comparison.extras import require_extra

from fogbank_cli.comparison_progress import ComparisonBar
from fogbank_cli.figures.scenes import SCENES, SHARED
from fogbank_cli.parameter_types import DurationType, NumbersType, SizeType
from fogbank_cli.session import Session, folder_option, json_option, pass_session

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

METHODS = ("volpath", "photon-beams", "radiance-cache-unaware", "radiance-cache")
AWARE = "radiance-cache:single_scattering=cached"
SPHERES = "radiance-cache:spheres+single_scattering=cached"
UNAWARE = "radiance-cache-unaware"
CACHES = (AWARE, SPHERES, UNAWARE)
"""At equal records: all light that can come from records does, in all of them, as in the authors' caches."""


@dataclass(frozen=True)
class TalkScene:
    """A scene of the talk, or what we have in its place."""

    name: str
    path: Path
    size: tuple[int, int]
    what: str
    """For people, when it isn't there."""
    parameters: dict[str, str] = field(default_factory=dict)
    """Values for `$name` in the XML."""
    minimum_radii: tuple[float, ...] = ()
    """Of further variants of the unaware cache, in radii of the scene."""


STATUES = (
    TalkScene(
        "room_fog",
        SHARED / "data" / "statues" / "room_fog.xml",
        (192, 108),
        "a room with statues in fog",
        minimum_radii=(0.02, 0.05),
    ),
)
STAIRCASE = (
    # The rival has records of isotropic fog only.
    TalkScene("stairs", SCENES / "stairs" / "stairs.xml", (128, 128), "a stairwell", {"g": "0"}),
    TalkScene("staircase2", SHARED / "data" / "staircase2" / "fog.xml", (192, 108), "a hall with floating steps"),
)


def talk_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds what both figures take."""
    for option in (
        click.option("--threads", type=click.IntRange(1), help="Of every method; one per core by default."),
        click.option("--size", type=SizeType(), help="Of the film in pixels; small by default."),
        click.option("--make-reference", type=DurationType(), default="10m", show_default=True, help="Time for it."),
        click.option("--seeds", type=click.IntRange(1), default=2, show_default=True, help="Pictures of each budget."),
        click.option(
            "--records",
            type=NumbersType(),
            default=(1000.0, 2000.0, 4000.0, 8000.0),
            show_default="1000,2000,4000,8000",
            help="Of the comparison at equal records.",
        ),
        click.option(
            "--spp",
            type=click.IntRange(1),
            default=128,
            show_default=True,
            help="Samples per pixel at equal records; what no record holds is sampled.",
        ),
        click.option(
            "--budgets",
            type=NumbersType(),
            default=(2.0, 5.0, 10.0, 30.0),
            show_default="2,5,10,30",
            help="Seconds of the comparison at equal time.",
        ),
        click.option("--scene", "path", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Another."),
        folder_option,
    ):
        command = option(command)
    return command


@click.command()
@talk_options
@json_option
@pass_session
def statues(session: Session, /, folder: Path, path: Path | None, **options: object) -> None:
    """Compare path tracing, photon beams and both caches in a room with statues (of the shared data).

    At equal records also ellipsoids against spheres, and the unaware cache with two minimum radii of its extents.
    Writes a report at equal time and one at equal records, tables.md and the numbers as CSV. Goes on where it was.
    """
    reproduce(session, STATUES, folder, path, Budgets(**options))  # type: ignore[arg-type]


@click.command()
@talk_options
@json_option
@pass_session
def staircase(session: Session, /, folder: Path, path: Path | None, **options: object) -> None:
    """Compare path tracing, photon beams and both caches in scenes/stairs and, where it is, the shared staircase.

    Writes a report at equal time and one at equal records, tables.md and the numbers as CSV. Goes on where it was.
    """
    reproduce(session, STAIRCASE, folder, path, Budgets(**options))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Budgets:
    """How long and how large."""

    budgets: tuple[float, ...]
    records: tuple[float, ...]
    spp: int
    seeds: int
    make_reference: float
    size: tuple[int | None, int | None] | None
    threads: int | None


def reproduce(session: Session, scenes: tuple[TalkScene, ...], folder: Path, path: Path | None, how: Budgets) -> None:
    """Both comparisons of each scene that is there, the cost of derivatives, and the tables."""
    try:
        require_extra()
    except ModuleNotFoundError as error:
        raise click.UsageError(str(error)) from None
    from fogbank_cli.figures.talk_tables import Caches, measure_overhead, tables

    if session.server is not None:
        raise click.UsageError("comparisons start servers of their own; leave out --server")
    output = session.output
    if path is not None:
        scenes = (TalkScene(path.stem, path, (0, 0), "the scene of --scene", minimum_radii=scenes[0].minimum_radii),)
    for scene in scenes:
        if not scene.path.is_file():
            output.note(f"NOT COMPARED: {scene.name}, {scene.what}: {scene.path} is not there (the shared data)")
    present = [scene for scene in scenes if scene.path.is_file()]
    if not present:
        raise click.UsageError("none of the figure's scenes is there; name one with --scene")
    folder.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    for scene in present:
        place = folder / scene.name
        with session.connect() as service:
            known = service.capabilities.integrators
            methods = [name for name in METHODS if name in known]
            for name in METHODS:
                if name not in known:
                    output.note(f"{name} is no integrator of this server; left out")
            loaded = service.load(scene.path, parameters=scene.parameters)
            overheads = measure_overhead(loaded)
            caches = [name for name in CACHES if name.partition(":")[0] in known]
            if UNAWARE in known:
                caches += [
                    f"{UNAWARE}:minimum_radius={share * loaded.bounds.radius:.2g}" for share in scene.minimum_radii
                ]
        common = {
            "seeds": how.seeds,
            "parameters": scene.parameters,
            "size": how.size or (scene.size if all(scene.size) else None),
            "threads": how.threads,
            "command": shlex.join(["fogbank", *sys.argv[1:]]),
        }
        with ComparisonBar(output) as bar:
            by_time = fogbank.compare(
                scene.path,
                place / "equal_time",
                methods=methods,
                budgets=how.budgets,
                make_reference=how.make_reference,
                on_progress=bar.progress,
                **common,  # type: ignore[arg-type]
            )
            by_records = fogbank.compare(
                scene.path,
                place / "equal_records",
                methods=caches,
                budgets=how.records,
                equal="records",
                spp=how.spp,
                reference=place / "equal_time" / "reference.exr",
                on_progress=bar.progress,
                **common,  # type: ignore[arg-type]
            )
        output.event("scene", scene=scene.name, reports=[by_time.report, by_records.report])
        settings = "".join(f", {name} = {value}" for name, value in scene.parameters.items())
        lines += tables(f"{scene.name}{settings}", by_time, by_records, Caches(AWARE, SPHERES, UNAWARE), overheads)
    summary = folder / "tables.md"
    summary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    output.event("done", tables=summary)
    for line in lines:
        output.text(line)
    output.text(str(summary))
