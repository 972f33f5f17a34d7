"""`fogbank job`: jobs on a server."""

from __future__ import annotations

from pathlib import Path

import click
import fogbank
from fogbank.job_report import ENDED_STATES

from fogbank_cli.image_output import exposure_option, follow_and_save, watch_tev_option
from fogbank_cli.output import duration, quantity
from fogbank_cli.parameter_types import ImagePathType
from fogbank_cli.session import Session, find, json_option, pass_session, short_id

_STATES = [state for state in fogbank.JobState if state is not fogbank.JobState.UNKNOWN]


@click.group()
def job() -> None:
    """List, show, watch, hold and cancel jobs."""


@job.command("ls")
@click.option(
    "--state", "states", type=click.Choice([str(state) for state in _STATES]), multiple=True, help="Only these."
)
@json_option
@pass_session
def list_jobs(session: Session, /, states: tuple[str, ...]) -> None:
    """List jobs, newest first."""
    output = session.output
    rows = []
    with session.connect() as service:
        for item in service.jobs(states=[fogbank.JobState(state) for state in states]):
            output.event("job", **_fields(item))
            rows.append(
                (
                    item.name.removeprefix("jobs/"),
                    str(item.state),
                    f"{100.0 * item.progress.fraction:.0f} %",
                    short_id(item.scene_name),
                    str(item.settings.get("integrator", "")),
                    f"{item.create_time.astimezone():%Y-%m-%d %H:%M:%S}",
                )
            )
    output.table(("JOB", "STATE", "DONE", "SCENE", "INTEGRATOR", "CREATED"), rows)


@job.command()
@click.argument("name")
@json_option
@pass_session
def show(session: Session, /, name: str) -> None:
    """Show the job NAME: jobs/{id}, or the beginning of the id."""
    output = session.output
    with session.connect() as service:
        item = _find(service, name)
    output.event("job", **_fields(item))
    output.text(f"{item.name}: {item.state}")
    lines = {"scene": item.scene_name, "created": f"{item.create_time.astimezone():%Y-%m-%d %H:%M:%S}"}
    progress = item.progress
    lines["progress"] = f"{100.0 * progress.fraction:.0f} %, {progress.samples_per_pixel_done} spp," + (
        f" {quantity(progress.rays, 'rays')}, {duration(progress.elapsed_seconds)}"
    )
    if item.error is not None:
        lines["error"] = f"{item.error.message} [{item.error.reason}]"
    for label, text in lines.items():
        output.text(f"  {label:<18}{text}")
    for label, value in item.settings.items():
        output.text(f"  {label:<18}{value}")


@job.command()
@click.argument("name")
@click.option("-o", "--output", "paths", type=ImagePathType(), multiple=True, help=".exr or .png; may be repeated.")
@exposure_option
@watch_tev_option
@json_option
@pass_session
def watch(
    session: Session,
    /,
    name: str,
    paths: tuple[Path, ...],
    exposure: float,
    watch_tev: tuple[str, int] | None,
) -> None:
    """Follow the job NAME to its end, and write its image if -o is given. Ctrl-C leaves; the job goes on."""
    with session.connect() as service:
        item = _find(service, name)
        session.output.event("job", **_fields(item))
        follow_and_save(
            item,
            session.output,
            paths,
            tev_address=watch_tev,
            exposure=exposure,
            on_interrupt="leave",
            load_seconds=0.0,
        )


@job.command()
@click.argument("names", nargs=-1, required=True)
@json_option
@pass_session
def cancel(session: Session, /, names: tuple[str, ...]) -> None:
    """Cancel the jobs NAMES; one that has ended stays as it is."""
    with session.connect() as service:
        for name in names:
            item = _find(service, name)
            had_ended = item.state in ENDED_STATES
            item.cancel()
            session.output.event("cancelled", job=item.name, state=str(item.state))
            session.output.text(f"{item.name}: {f'was {item.state} already' if had_ended else 'cancelled'}")


@job.command()
@click.argument("names", nargs=-1, required=True)
@json_option
@pass_session
def pause(session: Session, /, names: tuple[str, ...]) -> None:
    """Hold the jobs NAMES until they are resumed; one that has ended stays as it is."""
    with session.connect() as service:
        for name in names:
            item = _find(service, name)
            item.pause()
            _report_state(session, "paused", item)


@job.command()
@click.argument("names", nargs=-1, required=True)
@json_option
@pass_session
def resume(session: Session, /, names: tuple[str, ...]) -> None:
    """Go on with the paused jobs NAMES; any other stays as it is."""
    with session.connect() as service:
        for name in names:
            item = _find(service, name)
            item.resume()
            _report_state(session, "resumed", item)


def _report_state(session: Session, event: str, item: fogbank.Job) -> None:
    session.output.event(event, job=item.name, state=str(item.state))
    session.output.text(f"{item.name}: {item.state}")


def _find(service: fogbank.Service, name: str) -> fogbank.Job:
    return find(name, "jobs", service.job, service.jobs())


def _fields(item: fogbank.Job) -> dict[str, object]:
    return {
        "job": item.name,
        "scene": item.scene_name,
        "state": str(item.state),
        "priority": item.priority,
        "restarts": item.restarts,
        "create_time": item.create_time,
        "start_time": item.start_time,
        "end_time": item.end_time,
        "settings": item.settings,
        "progress": item.progress,
        "statistics": item.statistics,
        "error": None if item.error is None else {"message": item.error.message, "reason": item.error.reason},
    }
