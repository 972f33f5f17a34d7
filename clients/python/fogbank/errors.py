"""Exceptions of this package: one class per canonical gRPC code, and a few that only a client can know.

Each carries the server's machine-readable `reason` (stable, UPPER_SNAKE_CASE) and its message (for people).
"""

from __future__ import annotations

from collections.abc import Mapping

import grpc
from google.rpc import error_details_pb2, status_pb2
from grpc_status import rpc_status

ERROR_DOMAIN = "fogbank"


class FogbankError(Exception):
    """Anything that went wrong, in the server or on the way to it.

    Attributes:
        message: for people; scene errors name file, line and element.
        reason: stable word such as "SCENE_NOT_FOUND"; empty when the error did not come from a Fogbank server.
        metadata: names the field, path or limit concerned.
        code: the canonical gRPC code; None for errors that this package found by itself.
        retry_after_seconds: when asking again may help, if the server said so.
    """

    def __init__(
        self,
        message: str,
        *,
        reason: str = "",
        metadata: Mapping[str, str] | None = None,
        code: grpc.StatusCode | None = None,
    ) -> None:
        """See the class for the meaning of the arguments."""
        super().__init__(message)
        self.message = message
        self.reason = reason
        self.metadata = dict(metadata or {})
        self.code = code
        self.retry_after_seconds: float | None = None


class InvalidArgumentError(FogbankError):
    """A setting, name or request that is wrong and stays wrong (INVALID_ARGUMENT, OUT_OF_RANGE)."""


class InvalidSceneError(InvalidArgumentError):
    """A scene that cannot be loaded: malformed, incomplete, unsupported, or reaching outside its root."""


class NotFoundError(FogbankError):
    """A scene or job that the server does not know (NOT_FOUND)."""


class AlreadyExistsError(FogbankError):
    """A request id that was used for something else (ALREADY_EXISTS)."""


class FailedPreconditionError(FogbankError):
    """Right request, wrong moment, such as the image of a job that has none (FAILED_PRECONDITION)."""


class ResourceExhaustedError(FogbankError):
    """Over a limit of the server; `fogbank server capabilities` lists them (RESOURCE_EXHAUSTED)."""


class UnauthenticatedError(FogbankError):
    """The server wants to know who asks (UNAUTHENTICATED)."""


class PermissionDeniedError(FogbankError):
    """The server knows who asks, and refuses (PERMISSION_DENIED)."""


class UnsupportedError(FogbankError):
    """Not in this version of the server (UNIMPLEMENTED)."""


class UnavailableError(FogbankError):
    """The server cannot be reached, retries included (UNAVAILABLE)."""


class ServerStartError(UnavailableError):
    """The embedded server did not come up, or died; the message ends with the tail of its log."""


class AbortedError(FogbankError):
    """Lost against a concurrent request; a retry may succeed (ABORTED)."""


class DeadlineExceededError(FogbankError):
    """Not done in time (DEADLINE_EXCEEDED)."""


class CallCancelledError(FogbankError):
    """The call was cancelled (CANCELLED)."""


class DataLossError(FogbankError):
    """Stored or received data is damaged (DATA_LOSS, or a wrong SHA-256)."""


class InternalError(FogbankError):
    """A bug of the server, or an answer that breaks the contract (INTERNAL, UNKNOWN)."""


class JobFailedError(FogbankError):
    """The job ended with an error."""


class JobCancelledError(FogbankError):
    """The job was cancelled, by a client or by the server's shutdown."""


ERROR_CLASSES: dict[grpc.StatusCode, type[FogbankError]] = {
    grpc.StatusCode.INVALID_ARGUMENT: InvalidArgumentError,
    grpc.StatusCode.OUT_OF_RANGE: InvalidArgumentError,
    grpc.StatusCode.NOT_FOUND: NotFoundError,
    grpc.StatusCode.ALREADY_EXISTS: AlreadyExistsError,
    grpc.StatusCode.FAILED_PRECONDITION: FailedPreconditionError,
    grpc.StatusCode.RESOURCE_EXHAUSTED: ResourceExhaustedError,
    grpc.StatusCode.UNAUTHENTICATED: UnauthenticatedError,
    grpc.StatusCode.PERMISSION_DENIED: PermissionDeniedError,
    grpc.StatusCode.UNIMPLEMENTED: UnsupportedError,
    grpc.StatusCode.UNAVAILABLE: UnavailableError,
    grpc.StatusCode.ABORTED: AbortedError,
    grpc.StatusCode.DEADLINE_EXCEEDED: DeadlineExceededError,
    grpc.StatusCode.CANCELLED: CallCancelledError,
    grpc.StatusCode.DATA_LOSS: DataLossError,
    grpc.StatusCode.INTERNAL: InternalError,
    grpc.StatusCode.UNKNOWN: InternalError,
}


def from_rpc_error(error: grpc.RpcError) -> FogbankError:
    """The exception for a failed call, with reason and metadata of the ErrorInfo in its details, if there is one."""
    if not isinstance(error, grpc.Call):
        return InternalError(str(error))
    code = error.code()
    message = error.details() or code.name
    try:
        status = rpc_status.from_call(error)
    except ValueError:
        # Code or message of the details differ from the call's own: not from a Fogbank server.
        status = None
    reason, metadata = _error_info(status) if status else ("", {})
    exception = ERROR_CLASSES.get(code, InternalError)(message, reason=reason, metadata=metadata, code=code)
    exception.retry_after_seconds = _retry_delay(status) if status else None
    return exception


def scene_error(error: FogbankError) -> FogbankError:
    """Turns an error of scene loading into InvalidSceneError where the scene is to blame, else returns it as it is."""
    scene_is_to_blame = (
        isinstance(error, UnsupportedError)
        or error.reason == "FILE_NOT_FOUND"
        or (
            isinstance(error, InvalidArgumentError)
            and error.reason not in ("INVALID_REQUEST_ID", "INVALID_SHA256", "INVALID_UPLOAD")
        )
    )
    # UNIMPLEMENTED without a reason comes from a server that does not know the rpc at all.
    if not scene_is_to_blame or not error.reason:
        return error
    return InvalidSceneError(error.message, reason=error.reason, metadata=error.metadata, code=error.code)


def job_error(state_is_cancelled: bool, status: status_pb2.Status) -> FogbankError:
    """The exception for a job that ended without an image, from the status that it ended with."""
    reason, metadata = _error_info(status)
    code = _CODES.get(status.code, grpc.StatusCode.UNKNOWN)
    if state_is_cancelled:
        return JobCancelledError(status.message or "the job was cancelled", reason=reason, metadata=metadata, code=code)
    return JobFailedError(status.message or "the job failed", reason=reason, metadata=metadata, code=code)


_CODES: dict[int, grpc.StatusCode] = {code.value[0]: code for code in grpc.StatusCode}


def _error_info(status: status_pb2.Status) -> tuple[str, dict[str, str]]:
    for detail in status.details:
        info = error_details_pb2.ErrorInfo()
        if detail.Unpack(info) and info.domain == ERROR_DOMAIN:
            return info.reason, dict(info.metadata)
    return "", {}


def _retry_delay(status: status_pb2.Status) -> float | None:
    for detail in status.details:
        info = error_details_pb2.RetryInfo()
        if detail.Unpack(info):
            return float(info.retry_delay.ToTimedelta().total_seconds())
    return None
