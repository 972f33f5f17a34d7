"""Job templates of Open Job Description, by which other schedulers run Fogbank.

A job has three steps. Fill makes the records that all frames need and writes them to a file. Tiles renders bands of
frames, some in each task, from nothing but that file. Assemble joins the bands. Steps meet in one folder that all
machines share; every task is a process of the command `fogbank` with a server of its own. Since no task decides by
itself how good its part is to be, the assembled picture is, bit for bit, the one that a single machine makes from these
records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

# https://github.com/OpenJobDescription/openjd-specifications, revision 2023-09; chunks are an extension of it.
_SPECIFICATION = "jobtemplate-2023-09"
_EXTENSIONS = ("TASK_CHUNKING",)

# Longest name of a job.
_LONGEST_NAME = 128

_FOLDER = "{{Param.Folder}}"
_DATA = "{{Session.WorkingDirectory}}/data"
_CACHE = f"{_FOLDER}/records.cache"


@dataclass(frozen=True)
class PictureTask:
    """What a template renders."""

    scene: Path
    """The XML file."""

    folder: Path
    """Where parts and pictures go, shared by all machines."""

    loading: Sequence[str]
    """Arguments of `fogbank` for loading the scene, `root` apart."""

    record_arguments: Sequence[str] | None
    """Arguments of `fogbank cache fill`; None for an integrator without a cache."""

    picture_arguments: Sequence[str]
    """Arguments of `fogbank render` and `fogbank sweep`, the number of samples among them."""

    bands: int
    """Horizontal bands that a film is divided into, >= 1."""

    bands_per_task: int
    """Of these a task renders so many, >= 1, if the scheduler doesn't choose."""

    root: Path | None = None
    """Folder with all files of the scene; the XML file's own when None."""

    cameras: Path | None = None
    """JSON list of keyframes; None for the scene's own camera or an orbit."""

    path_arguments: Sequence[str] = ()
    """Arguments of `fogbank sweep` for the camera path, `cameras` apart."""

    frames: int | None = None
    """Frames of the path; None for one picture by the scene's own camera."""


def job_template(name: str, task: PictureTask, place: Path) -> dict[str, Any]:
    """The template, ready to be written as JSON or YAML.

    Args:
        name: of the job.
        task: what it renders.
        place: folder that it will lie in: paths below it have defaults, others are given when the job is submitted.
    """
    steps = [_fill_step(task)] if task.record_arguments is not None else []
    steps += [_tiles_step(task), _assemble_step(task)]
    for before, step in pairwise(steps):
        step["dependencies"] = [{"dependsOn": before["name"]}]
    return {
        "specificationVersion": _SPECIFICATION,
        "extensions": list(_EXTENSIONS),
        "name": name[:_LONGEST_NAME],
        "parameterDefinitions": _parameters(task, place),
        "jobEnvironments": [
            {
                "name": "Fogbank",
                # Tasks have servers of their own, whatever the machine's user prefers.
                "variables": {"FOGBANK_SERVER": ""},
                "script": {"actions": {"onEnter": {"command": "mkdir", "args": ["-p", f"{_FOLDER}/parts"]}}},
            }
        ],
        "steps": steps,
    }


def submission_parameters(task: PictureTask, place: Path) -> dict[str, Path]:
    """Those paths that the template, in its place, has no defaults for: by the specification they lie below it."""
    paths = {"Scene": task.scene, "Root": task.root, "Folder": task.folder, "Cameras": task.cameras}
    return {
        name: path for name, path in paths.items() if path is not None and not path.absolute().is_relative_to(place)
    }


def _parameters(task: PictureTask, place: Path) -> list[dict[str, Any]]:
    parameters: list[dict[str, Any]] = []

    def add(name: str, path: Path | None, kind: str, flow: str, description: str) -> None:
        if path is None:
            return
        parameter = {"name": name, "type": "PATH", "objectType": kind, "dataFlow": flow, "description": description}
        if path.absolute().is_relative_to(place):
            parameter["default"] = path.absolute().relative_to(place).as_posix()
        parameters.append(parameter)

    add("Scene", task.scene, "FILE", "IN", "Mitsuba 3 XML file.")
    add("Root", task.root, "DIRECTORY", "IN", "Folder with all files of the scene.")
    add("Folder", task.folder, "DIRECTORY", "OUT", "For parts and pictures, shared by all machines.")
    add("Cameras", task.cameras, "FILE", "IN", "JSON list of keyframes.")
    return [
        *parameters,
        {
            "name": "Fogbank",
            "type": "STRING",
            "default": "fogbank",
            "description": "The command fogbank, on the PATH of the workers or with its path.",
        },
        {
            "name": "BandsPerTask",
            "type": "INT",
            "default": task.bands_per_task,
            "minValue": 1,
            "maxValue": task.bands,
            "description": f"Bands of a frame, of {task.bands}, that a task renders.",
        },
    ]


def _run(*arguments: str) -> dict[str, Any]:
    return {
        "actions": {
            "onRun": {
                "command": "{{Param.Fogbank}}",
                "args": ["--data", _DATA, *arguments, "--openjd"],
                "cancelation": {"mode": "NOTIFY_THEN_TERMINATE"},
            }
        }
    }


def _loading(task: PictureTask) -> list[str]:
    return [*task.loading, *(["--root", "{{Param.Root}}"] if task.root is not None else [])]


def _path(task: PictureTask) -> list[str]:
    cameras = ["--cameras", "{{Param.Cameras}}"] if task.cameras is not None else []
    return [*cameras, *task.path_arguments]


def _fill_step(task: PictureTask) -> dict[str, Any]:
    arguments = [*_path(task), *_loading(task), *(task.record_arguments or ())]
    return {"name": "Fill", "script": _run("cache", "fill", "{{Param.Scene}}", "--export", _CACHE, *arguments)}


def _tiles_step(task: PictureTask) -> dict[str, Any]:
    parameters: list[dict[str, Any]] = [
        {
            "name": "Bands",
            "type": "CHUNK[INT]",
            "range": f"1-{task.bands}",
            "chunks": {"defaultTaskCount": "{{Param.BandsPerTask}}", "rangeConstraint": "CONTIGUOUS"},
        }
    ]
    arguments = ["--bands", f"{{{{Task.Param.Bands}}}}/{task.bands}", *_loading(task), *task.picture_arguments]
    if task.record_arguments is not None:
        arguments += ["--cache", _CACHE, "--records", "0"]
    if task.frames is None:
        run = _run("render", "{{Param.Scene}}", "-o", f"{_FOLDER}/parts/{{{{Task.Param.Bands}}}}.exr", *arguments)
    else:
        parameters.insert(0, _frames(task.frames))
        part = f"{_FOLDER}/parts/%04d_{{{{Task.Param.Bands}}}}.exr"
        frame = ["--only", "{{Task.Param.Frame}}"]
        run = _run("sweep", "{{Param.Scene}}", "-o", part, *frame, *_path(task), *arguments)
    return {"name": "Tiles", "parameterSpace": {"taskParameterDefinitions": parameters}, "script": run}


def _assemble_step(task: PictureTask) -> dict[str, Any]:
    if task.frames is None:
        return {"name": "Assemble", "script": _run("join", f"{_FOLDER}/parts/*.exr", "-o", f"{_FOLDER}/picture.exr")}
    names = [f"{_FOLDER}/parts/%04d_*.exr", "-o", f"{_FOLDER}/%04d.exr"]
    return {
        "name": "Assemble",
        "parameterSpace": {"taskParameterDefinitions": [_frames(task.frames)]},
        "script": _run("join", *names, "--frame", "{{Task.Param.Frame}}"),
    }


def _frames(count: int) -> dict[str, Any]:
    return {"name": "Frame", "type": "INT", "range": f"0-{count - 1}"}
