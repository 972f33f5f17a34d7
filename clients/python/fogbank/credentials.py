"""Who a client is to a server that asks, and how the connection is protected."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import grpc

from fogbank.errors import InvalidArgumentError

Request = TypeVar("Request")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Credentials:
    """Of one client; by default of one that nobody asks.

    A connection is encrypted when `tls` is set, or `ca`, or `certificate`. A token is sent over connections that are
    encrypted or stay on this machine, and over no others.
    """

    token: str | None = field(default=None, repr=False)
    """As `fogbank token create` printed it."""

    ca: Path | None = None
    """PEM file of the authority that signed the server's certificate; None for those that the machine trusts."""

    certificate: Path | None = None
    """PEM file of this client's own certificate, instead of a token; needs `key`."""

    key: Path | None = field(default=None, repr=False)
    """PEM file of the certificate's private key."""

    tls: bool = False
    """Encrypts, by the authorities that the machine trusts."""

    @classmethod
    def from_environment(cls) -> Credentials:
        """From FOGBANK_TOKEN, FOGBANK_CA, FOGBANK_CERTIFICATE, FOGBANK_KEY and FOGBANK_TLS=1, where they are set."""
        path = {name: os.environ.get(f"FOGBANK_{name}") for name in ("CA", "CERTIFICATE", "KEY")}
        return cls(
            token=os.environ.get("FOGBANK_TOKEN") or None,
            ca=Path(path["CA"]) if path["CA"] else None,
            certificate=Path(path["CERTIFICATE"]) if path["CERTIFICATE"] else None,
            key=Path(path["KEY"]) if path["KEY"] else None,
            tls=os.environ.get("FOGBANK_TLS", "") not in ("", "0"),
        )

    @property
    def encrypted(self) -> bool:
        """Whether connections are encrypted."""
        return self.tls or self.ca is not None or self.certificate is not None

    def check(self, target: str) -> None:
        """Raises InvalidArgumentError for what does not go together, and for a token that others could read."""
        if (self.certificate is None) != (self.key is None):
            raise InvalidArgumentError("a client's certificate and its key belong together")
        if self.token is not None and not self.encrypted and not _stays_here(target):
            raise InvalidArgumentError(
                f"the token would be sent to {target} for everybody to read: give the authority of the server's "
                "certificate (ca, FOGBANK_CA), or FOGBANK_TLS=1"
            )

    def channel(self, target: str, options: tuple[tuple[str, int], ...]) -> tuple[grpc.Channel, grpc.Channel]:
        """A channel to `target`, and what calls are to be made with: the same, or one that adds the token.

        Raises OSError for files that cannot be read.
        """
        if self.encrypted:
            credentials = grpc.ssl_channel_credentials(
                root_certificates=None if self.ca is None else self.ca.read_bytes(),
                private_key=None if self.key is None else self.key.read_bytes(),
                certificate_chain=None if self.certificate is None else self.certificate.read_bytes(),
            )
            channel = grpc.secure_channel(target, credentials, options=options)
        else:
            channel = grpc.insecure_channel(target, options=options)
        if self.token is None:
            return channel, channel
        return channel, grpc.intercept_channel(channel, _Bearer(self.token))


class _Bearer(
    grpc.UnaryUnaryClientInterceptor,
    grpc.UnaryStreamClientInterceptor,
    grpc.StreamUnaryClientInterceptor,
    grpc.StreamStreamClientInterceptor,
):
    """Adds the token to every call; gRPC's own call credentials refuse connections in the clear, sockets included."""

    def __init__(self, token: str) -> None:
        """Remembers the token."""
        self._header = ("authorization", f"Bearer {token}")

    def _intercept(
        self,
        proceed: Callable[[grpc.ClientCallDetails, Request], Result],
        details: grpc.ClientCallDetails,
        request: Request,
    ) -> Result:
        return proceed(_Details(details, (*(details.metadata or ()), self._header)), request)

    # gRPC passes the arguments by position; its stubs want their names, too.
    intercept_unary_unary = _intercept  # type: ignore[assignment]
    intercept_unary_stream = _intercept  # type: ignore[assignment]
    intercept_stream_unary = _intercept  # type: ignore[assignment]
    intercept_stream_stream = _intercept  # type: ignore[assignment]


class _Details(grpc.ClientCallDetails):
    """A call's details with other metadata."""

    def __init__(self, details: grpc.ClientCallDetails, metadata: tuple[tuple[str, str | bytes], ...]) -> None:
        """All else as in `details`."""
        self.method = details.method
        self.timeout = details.timeout
        self.metadata = metadata
        self.credentials = details.credentials
        self.wait_for_ready = getattr(details, "wait_for_ready", None)
        self.compression = getattr(details, "compression", None)


def _stays_here(target: str) -> bool:
    host = target.rpartition(":")[0]
    return target.startswith("unix:") or host in ("localhost", "[::1]") or host.startswith("127.")
