"""What the exit status of `fogbank` means; scripts rely on it."""

from __future__ import annotations

from enum import IntEnum

import click
from fogbank import (
    FailedPreconditionError,
    InvalidArgumentError,
    InvalidSceneError,
    JobCancelledError,
    JobFailedError,
    NotFoundError,
    PermissionDeniedError,
    ResourceExhaustedError,
    UnauthenticatedError,
    UnavailableError,
)


class ExitCode(IntEnum):
    """Exit status of the command."""

    OK = 0
    INTERNAL = 1
    USAGE = 2
    SCENE_INVALID = 3
    SERVER_UNREACHABLE = 4
    JOB_FAILED = 5
    NOT_FOUND = 6
    LIMIT = 7
    LOCAL_FILE = 8
    NOT_ALLOWED = 9
    CANCELLED = 130


DESCRIPTIONS: dict[ExitCode, str] = {
    ExitCode.OK: "done",
    ExitCode.INTERNAL: "an error of the server or of this program; or nobody reads its output",
    ExitCode.USAGE: "wrong use: an unknown option, or a setting that the server refuses",
    ExitCode.SCENE_INVALID: "the scene cannot be loaded; the message names file, line and element",
    ExitCode.SERVER_UNREACHABLE: "the server cannot be reached, or the embedded one does not come up",
    ExitCode.JOB_FAILED: "the job ended with an error, or has no image",
    ExitCode.NOT_FOUND: "no such scene, job or cache",
    ExitCode.LIMIT: "over a limit of the server (`fogbank server capabilities` lists them)",
    ExitCode.LOCAL_FILE: "a file of this machine cannot be written or read",
    ExitCode.NOT_ALLOWED: "the server wants a token, or a better one",
    ExitCode.CANCELLED: "the job was cancelled, or the command interrupted (Ctrl-C)",
}

# The first class that fits counts, so special ones stand before general ones.
_BY_ERROR: tuple[tuple[type[BaseException], ExitCode], ...] = (
    (click.Abort, ExitCode.CANCELLED),
    (KeyboardInterrupt, ExitCode.CANCELLED),
    (click.UsageError, ExitCode.USAGE),
    (InvalidSceneError, ExitCode.SCENE_INVALID),
    (InvalidArgumentError, ExitCode.USAGE),
    (UnavailableError, ExitCode.SERVER_UNREACHABLE),
    (JobFailedError, ExitCode.JOB_FAILED),
    (FailedPreconditionError, ExitCode.JOB_FAILED),
    (JobCancelledError, ExitCode.CANCELLED),
    (NotFoundError, ExitCode.NOT_FOUND),
    (ResourceExhaustedError, ExitCode.LIMIT),
    (UnauthenticatedError, ExitCode.NOT_ALLOWED),
    (PermissionDeniedError, ExitCode.NOT_ALLOWED),
    (OSError, ExitCode.LOCAL_FILE),
)


def exit_code(error: BaseException) -> ExitCode:
    """The exit status for an error that ended the command."""
    return next((code for kind, code in _BY_ERROR if isinstance(error, kind)), ExitCode.INTERNAL)


def help_table() -> str:
    """The table for `fogbank --help`."""
    # \b keeps click from re-wrapping the lines.
    return "\n".join(["\b", "Exit status:", *(f"  {code.value:>3}  {DESCRIPTIONS[code]}" for code in ExitCode)])
