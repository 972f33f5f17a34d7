"""The connection to a server: channel options, stubs, retries, and what a fork does to them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from typing import Protocol, TypeVar

import grpc
from grpc._cython import cygrpc  # type: ignore[attr-defined]  # in no stubs

from fogbank._generated.v1.cache_pb2_grpc import CacheServiceStub
from fogbank._generated.v1.farm_pb2_grpc import FarmServiceStub
from fogbank._generated.v1.flatland_pb2_grpc import FlatlandServiceStub
from fogbank._generated.v1.probe_pb2_grpc import ProbeServiceStub
from fogbank._generated.v1.render_pb2_grpc import RenderServiceStub
from fogbank._generated.v1.scene_pb2_grpc import SceneServiceStub
from fogbank._generated.v1.server_pb2_grpc import ServerServiceStub
from fogbank.credentials import Credentials
from fogbank.errors import FogbankError, UnavailableError, from_rpc_error
from fogbank.retry import Backoff, RetryPolicy
from fogbank.tracing import trace_metadata

# The same table as GetCapabilities.channel_arguments; an end-to-end test compares the two.
CHANNEL_OPTIONS: tuple[tuple[str, int], ...] = (
    # Finds half-open connections within a minute; faster pings make servers hang up with "too many pings".
    ("grpc.keepalive_time_ms", 30_000),
    ("grpc.keepalive_timeout_ms", 20_000),
    ("grpc.keepalive_permit_without_calls", 1),
    # No limit on pings while a stream is silent.
    ("grpc.http2.max_pings_without_data", 0),
    # With bandwidth probing the receive window grows without bound: 40 stalled streams took 2.3 GiB of memory.
    ("grpc.http2.bdp_probe", 0),
    # Two tile messages in flight; beyond that the server is held back and sends newer tiles instead.
    ("grpc.http2.lookahead_bytes", 65536),
)

# Large enough for full throughput, small enough that a broken stream repeats little; see also max_upload_chunk_bytes.
UPLOAD_CHUNK_BYTES = 256 * 1024

Metadata = tuple[tuple[str, str | bytes], ...]

Request_contra = TypeVar("Request_contra", contravariant=True)
Response_co = TypeVar("Response_co", covariant=True)

# Channels that were inherited through a fork. Their threads and sockets belong to the parent; destroying them in the
# child can hang or disturb the parent, so they are kept, untouched, until the process ends.
_inherited_channels: list[grpc.Channel] = []


class UnaryCall(Protocol[Request_contra, Response_co]):
    """A unary method of a stub."""

    def __call__(
        self, request: Request_contra, timeout: float | None = None, metadata: Metadata | None = None
    ) -> Response_co:
        """Sends the request and waits for the answer, at most `timeout` seconds."""
        ...


class Stubs:
    """The services of one channel."""

    def __init__(self, channel: grpc.Channel, calls: grpc.Channel) -> None:
        """Binds the stubs to `calls`, which is `channel` or adds something to its calls."""
        self.channel = channel
        self.scenes = SceneServiceStub(calls)
        self.render = RenderServiceStub(calls)
        self.caches = CacheServiceStub(calls)
        self.probe = ProbeServiceStub(calls)
        self.flatland = FlatlandServiceStub(calls)
        self.farm = FarmServiceStub(calls)
        self.server = ServerServiceStub(calls)


class Connection:
    """One server, reached from any thread of this process or of its forked children.

    Args:
        target: "host:port" or "unix:/path".
        credentials: who the client is, and whether the connection is encrypted.
        retry_policy: for calls and streams that meet UNAVAILABLE.
        explain_unavailable: asked for a better error when the server cannot be reached, such as the log of an
            embedded server that died; its answer is raised without further tries.

    Attributes:
        upload_chunk_bytes: of an upload message; whoever knows that the server takes less lowers it.
    """

    def __init__(
        self,
        target: str,
        *,
        credentials: Credentials | None = None,
        retry_policy: RetryPolicy | None = None,
        explain_unavailable: Callable[[], FogbankError | None] | None = None,
    ) -> None:
        """See the class for the meaning of the arguments."""
        self.target = target
        self._credentials = credentials or Credentials()
        self._credentials.check(target)
        self.retry_policy = retry_policy or RetryPolicy()
        self.upload_chunk_bytes = UPLOAD_CHUNK_BYTES
        self._explain_unavailable = explain_unavailable
        self._lock = threading.Lock()
        self._stubs: Stubs | None = None
        self._process_id = os.getpid()
        self._closed = False

    @property
    def stubs(self) -> Stubs:
        """The stubs of this process; a forked child gets a channel of its own."""
        if self._process_id != os.getpid():
            # Another thread of the parent may have held the lock at the moment of the fork.
            self._lock = threading.Lock()
            if self._stubs is not None:
                _inherited_channels.append(self._stubs.channel)
            self._stubs = None
            self._process_id = os.getpid()
        with self._lock:
            if self._closed:
                raise UnavailableError(f"the connection to {self.target} is closed")
            if self._stubs is None:
                channel, calls = self._credentials.channel(self.target, CHANNEL_OPTIONS)
                # In a forked child gRPC cancels the calls of the channels it knows of, for which it takes locks
                # that a thread of the parent may have held at that moment: then the child hangs for ever. Here
                # children leave inherited channels alone.
                cygrpc.fork_unregister_channel(channel)
                self._stubs = Stubs(channel, calls)
            return self._stubs

    def close(self) -> None:
        """Closes the channel; calls under way end with CallCancelledError. Harmless when repeated."""
        with self._lock:
            self._closed = True
            if self._stubs is not None and self._process_id == os.getpid():
                self._stubs.channel.close()
            self._stubs = None

    def call(
        self,
        method: Callable[[Stubs], UnaryCall[Request_contra, Response_co]],
        request: Request_contra,
        *,
        idempotent: bool = True,
        timeout: float | None = None,
    ) -> Response_co:
        """Calls a unary method; tries again after UNAVAILABLE when it is idempotent.

        Args:
            method: picks it from the stubs, for example `lambda stubs: stubs.render.GetJob`.
            request: its request.
            idempotent: whether a second try can do no harm.
            timeout: seconds for each try; None for no limit.
        """
        backoff = Backoff(self.retry_policy)
        while True:
            try:
                return method(self.stubs)(request, timeout=timeout, metadata=trace_metadata())
            except grpc.RpcError as rpc_error:
                error = self.translate(rpc_error)
                if not idempotent:
                    raise error from None
                self.wait_or_raise(backoff, error)

    def translate(self, rpc_error: grpc.RpcError) -> FogbankError:
        """The exception for a failed call."""
        error = from_rpc_error(rpc_error)
        if isinstance(error, UnavailableError) and not error.reason:
            error.message = f"cannot reach the server at {self.target}: {error.message}"
            error.args = (error.message,)
        return error

    def wait_or_raise(self, backoff: Backoff, error: FogbankError) -> None:
        """Waits before the next try, or raises: `error`, or the explanation of a server that is gone for good."""
        if isinstance(error, UnavailableError) and self._explain_unavailable is not None:
            explanation = self._explain_unavailable()
            if explanation is not None:
                raise explanation from None
        backoff.wait_or_raise(error)
