"""`fogbank cache`: radiance caches on a server."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import click
import fogbank
from fogbank import RenderOptions
from fogbank.cache_picture import draw

from fogbank_cli.camera_paths import camera_path_options, path_cameras
from fogbank_cli.filling import fill, tell_filled
from fogbank_cli.output import quantity
from fogbank_cli.parameter_types import SizeInBytesType
from fogbank_cli.render import UploadReport, load_scene
from fogbank_cli.render_options import cache_options
from fogbank_cli.session import Session, find, json_option, loading_options, openjd_option, pass_session, short_id

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.group()
def cache() -> None:
    """List, fill, move, check and draw radiance caches.

    CACHE is caches/{fingerprint}, the beginning of the fingerprint, or the .xml file of a scene.
    """


@cache.command("ls")
@json_option
@pass_session
def list_caches(session: Session, /) -> None:
    """List caches."""
    output = session.output
    rows = []
    with session.connect() as service:
        for item in service.caches():
            statistics = item.statistics
            output.event("cache", cache=item.name, **vars(statistics))
            rows.append(
                (
                    short_id(item.name),
                    str(statistics.records),
                    quantity(statistics.disk_bytes, "B"),
                    "in memory" if statistics.memory_bytes else "on disk",
                    str(statistics.epoch),
                    f"{statistics.last_use_time.astimezone():%Y-%m-%d %H:%M}",
                )
            )
    output.table(("CACHE", "RECORDS", "SIZE", "WHERE", "EPOCH", "LAST USED"), rows)


@cache.command()
@click.argument("name", metavar="CACHE")
@json_option
@pass_session
def show(session: Session, /, name: str) -> None:
    """Show what CACHE holds."""
    output = session.output
    with session.connect() as service:
        item = _find(service, name)
        statistics = item.show()
    output.event("cache", cache=item.name, **vars(statistics))
    output.text(item.name)
    lines = {
        "records": str(statistics.records),
        "epoch": str(statistics.epoch),
        "disk": f"{quantity(statistics.disk_bytes, 'B')} in {statistics.segments} files",
        "memory": quantity(statistics.memory_bytes, "B"),
        "last used": f"{statistics.last_use_time.astimezone():%Y-%m-%d %H:%M:%S}",
    }
    for label, text in lines.items():
        output.text(f"  {label:<12}{text}")
    output.table(
        ("  QUANTITY", "MEDIUM", "LIGHT GROUP", "GENERATION", "RECORDS"),
        [
            (
                f"  {component.quantity or 'unknown'}",
                str(component.medium),
                str(component.light_group),
                str(component.generation),
                str(component.records),
            )
            for component in statistics.components
        ],
    )


@cache.command("fill")
@click.argument("scene", type=click.Path(path_type=Path))
@camera_path_options
@cache_options
@click.option("--export", "exported", type=_FILE, help="Write the whole cache to this file when it is filled.")
@loading_options
@openjd_option
@json_option
@pass_session
def fill_cache(
    session: Session,
    /,
    scene: Path,
    cameras: Path | None,
    frames: int | None,
    orbit: int | None,
    target: tuple[float, float, float] | None,
    degrees: float | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    exported: Path | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Make the records that pictures of SCENE from some cameras need, the scene's own camera if none is given.

    What the cache holds is not made again. Ctrl-C ends the fill; the records made until then stay.
    """
    output = session.output
    with session.connect() as service:
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        path = []
        if cameras is not None or orbit is not None:
            path = path_cameras(loaded, cameras=cameras, frames=frames, orbit=orbit, target=target, degrees=degrees)
        report = fill(loaded.cache.name, loaded.cache.fill_events(path, **options), output)
        tell_filled(loaded.cache.name, report, output)
        if exported is not None:
            loaded.cache.export(exported)
    output.event("done", cache=loaded.cache.name, **vars(report))


@cache.command()
@click.argument("name", metavar="CACHE")
@click.argument("path", metavar="FILE", type=_FILE)
@json_option
@pass_session
def export(session: Session, /, name: str, path: Path) -> None:
    """Write the whole CACHE to FILE. The same records give the same bytes on any machine."""
    with session.connect() as service:
        item = _find(service, name)
        item.export(path)
    size = path.stat().st_size
    session.output.event("exported", cache=item.name, file=path, bytes=size)
    session.output.text(f"{path}: {item.name}, {quantity(size, 'B')}")


@cache.command("import")
@click.argument("path", metavar="FILE", type=_FILE)
@json_option
@pass_session
def import_cache(session: Session, /, path: Path) -> None:
    """Add the records of FILE, which was exported before, to the cache of their scene."""
    output = session.output
    with session.connect() as service:
        report = service.import_cache(path, on_progress=UploadReport(output))
    statistics = report.cache.statistics
    output.event("imported", cache=report.cache.name, file=path, records_new=report.records_new, **vars(statistics))
    output.text(f"{report.cache.name}: {report.records_new} new records, {statistics.records} in all")


@cache.command()
@click.argument("paths", metavar="FILE...", type=_FILE, nargs=-1, required=True)
@click.option("-o", "--output", "result", type=_FILE, required=True, help="File of the union.")
@json_option
@pass_session
def merge(session: Session, /, paths: tuple[Path, ...], result: Path) -> None:
    """Write the union of exported FILES of one scene; their order does not matter."""
    with session.connect() as service:
        service.merge_caches(paths, result)
    size = result.stat().st_size
    session.output.event("merged", files=list(paths), file=result, bytes=size)
    session.output.text(f"{result}: {quantity(size, 'B')}")


@cache.command()
@click.argument("names", metavar="[CACHE]...", nargs=-1)
@json_option
@pass_session
def verify(session: Session, /, names: tuple[str, ...]) -> None:
    """Check every byte of the CACHES, of all if none is named. What is damaged is set aside and made again."""
    output = session.output
    with session.connect() as service:
        items = [_find(service, name) for name in names] if names else list(service.caches())
        for item in items:
            report = item.verify()
            output.event("verified", cache=item.name, **vars(report))
            output.text(
                f"{short_id(item.name)}: {report.records} records, {quantity(report.bytes, 'B')} in"
                f" {report.segments} files, {report.damaged_segments} damaged"
            )


@cache.command()
@click.option("--budget", type=SizeInBytesType(), help="Bytes for all caches, e.g. 20G; the server's own by default.")
@json_option
@pass_session
def gc(session: Session, /, budget: int | None) -> None:
    """Free disk space: join files, and remove the caches used least recently while all are above the budget."""
    output = session.output
    with session.connect() as service:
        report = service.collect_cache_garbage(budget)
    output.event("collected", **vars(report))
    for name in report.removed:
        output.text(f"removed {name}")
    output.text(f"{quantity(report.bytes_before, 'B')} before, {quantity(report.bytes_after, 'B')} now")


@cache.command("rm")
@click.argument("names", metavar="CACHE...", nargs=-1, required=True)
@json_option
@pass_session
def remove(session: Session, /, names: tuple[str, ...]) -> None:
    """Remove the CACHES; running jobs go on with the records that they have."""
    with session.connect() as service:
        for name in names:
            item = _find(service, name)
            item.delete()
            session.output.event("deleted", cache=item.name)
            session.output.text(f"removed {item.name}")


@cache.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("-o", "--output", "path", type=_FILE, required=True, help=".png to write.")
@click.option("--side", type=click.IntRange(64), default=1400, show_default=True, help="Longer side in pixels.")
@click.option("--cut", type=float, help="Height at which the scene is cut open; the records' median by default.")
@click.option("--up", "up_axis", type=click.Choice(["x", "y", "z"]), help="Axis to look down; the camera's by default.")
@cache_options
@loading_options
@json_option
@pass_session
def view(
    session: Session,
    /,
    scene: Path,
    path: Path,
    side: int,
    cut: float | None,
    up_axis: str | None,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    **options: Unpack[RenderOptions],
) -> None:
    """Draw the records of SCENE from above, coloured by size, over the scene cut open."""
    if path.suffix.lower() != ".png":
        raise click.UsageError(f"{path}: the picture is a .png")
    output = session.output
    with session.connect() as service:
        loaded = load_scene(service, output, scene, parameters, lenient, root)
        axis = None if up_axis is None else "xyz".index(up_axis)
        found = loaded.cache.view(side=side, cut=cut, up_axis=axis, **options)
    draw(found).save(path)
    records = sum(extents.component.records for extents in found.records)
    output.event("done", image=path, cache=loaded.cache.name, records=records)
    output.text(f"{path}: {records} records")


def _find(service: fogbank.Service, name: str) -> fogbank.Cache:
    if name.lower().endswith(".xml"):
        return service.load(Path(name)).cache

    def get(exact: str) -> fogbank.Cache:
        item = service.cache(exact)
        item.show()
        return item

    return find(name, "caches", get, service.caches())
