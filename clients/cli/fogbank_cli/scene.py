"""`fogbank scene`: scenes on a server."""

from __future__ import annotations

from pathlib import Path

import click
import fogbank

from fogbank_cli.output import quantity
from fogbank_cli.render import UploadReport, report_scene
from fogbank_cli.session import Session, find, json_option, loading_options, pass_session, short_id


@click.group()
def scene() -> None:
    """Push, list, show and remove scenes."""


@scene.command()
@click.argument("path", type=click.Path(path_type=Path))
@loading_options
@click.option("--on-server", is_flag=True, help="PATH lies on the server, below its --scene-root.")
@json_option
@pass_session
def push(
    session: Session,
    /,
    path: Path,
    parameters: tuple[tuple[str, str], ...],
    lenient: bool,
    root: Path | None,
    on_server: bool,
) -> None:
    """Upload and load the scene PATH, a Mitsuba 3 XML file; print its name."""
    if on_server and root is not None:
        raise click.UsageError("--root is for local scenes; with --on-server the server's --scene-root is the root")
    output = session.output
    with session.connect() as service:
        if on_server:
            pushed = service.load_server_file(path.as_posix(), parameters=dict(parameters), lenient=lenient)
        else:
            pushed = service.load(
                path, parameters=dict(parameters), lenient=lenient, root=root, on_progress=UploadReport(output)
            )
        report_scene(pushed, output)
        output.text(pushed.name)


@scene.command("ls")
@json_option
@pass_session
def list_scenes(session: Session, /) -> None:
    """List scenes, newest first."""
    output = session.output
    rows = []
    with session.connect() as service:
        for item in service.scenes():
            output.event("scene", **_fields(item))
            rows.append(
                (
                    short_id(item.name),
                    item.main_path,
                    quantity(item.statistics.triangles, "triangles"),
                    quantity(item.statistics.memory_bytes, "B"),
                    "in memory" if item.resident else "on disk",
                    f"{item.create_time.astimezone():%Y-%m-%d %H:%M}",
                )
            )
    output.table(("SCENE", "FILE", "SIZE", "MEMORY", "WHERE", "CREATED"), rows)


@scene.command()
@click.argument("name")
@json_option
@pass_session
def show(session: Session, /, name: str) -> None:
    """Show the scene NAME: scenes/{fingerprint}, or the beginning of the fingerprint."""
    output = session.output
    with session.connect() as service:
        item = _find(service, name)
    output.event("scene", **_fields(item))
    output.text(item.name)
    statistics, times, defaults = item.statistics, item.load_times, item.defaults
    lines = {
        "file": item.main_path,
        "created": f"{item.create_time.astimezone():%Y-%m-%d %H:%M:%S}",
        "radiance fingerprint": item.radiance_fingerprint,
        "holds": f"{statistics.triangles} triangles, {statistics.shapes} shapes, {statistics.lights} lights,"
        f" {statistics.media} media",
        "memory": f"{quantity(statistics.memory_bytes, 'B')} ({'now' if item.resident else 'when loaded again'})",
        "files": quantity(statistics.file_bytes, "B"),
        "loading": f"{times.total_seconds:.3g} s (XML {times.parse_seconds:.3g}, meshes {times.meshes_seconds:.3g},"
        f" textures {times.textures_seconds:.3g}, BVH {times.bvh_seconds:.3g})",
        "defaults": f"{defaults.integrator}, {defaults.size[0]}x{defaults.size[1]}, {defaults.spp} spp,"
        f" max depth {defaults.max_depth}",
    }
    for label, text in lines.items():
        output.text(f"  {label:<22}{text}")
    for warning in item.warnings:
        output.text(f"  warning: {warning}")


@scene.command("rm")
@click.argument("names", nargs=-1, required=True)
@json_option
@pass_session
def remove(session: Session, /, names: tuple[str, ...]) -> None:
    """Make the server forget the scenes NAMES; running jobs keep what they use."""
    with session.connect() as service:
        for name in names:
            item = _find(service, name)
            item.delete()
            session.output.event("deleted", scene=item.name)
            session.output.text(f"removed {item.name}")


def _find(service: fogbank.Service, name: str) -> fogbank.Scene:
    return find(name, "scenes", service.scene, service.scenes())


def _fields(item: fogbank.Scene) -> dict[str, object]:
    return {
        "scene": item.name,
        "main_path": item.main_path,
        "radiance_fingerprint": item.radiance_fingerprint,
        "create_time": item.create_time,
        "resident": item.resident,
        "statistics": item.statistics,
        "load_times": item.load_times,
        "defaults": item.defaults,
        "warnings": item.warnings,
    }
