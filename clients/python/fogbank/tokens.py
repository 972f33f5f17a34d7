"""The bearer tokens of a server: the file `tokens.json` in its data directory, which the server reads again when it
changes.

The file holds no token, only hashes of their secrets, which are random and 256 bits long.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from fogbank.data_files import DataFile
from fogbank.errors import InvalidArgumentError, NotFoundError

SCOPES = ("render", "upload", "admin")
TENANT_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,31}")


@dataclass(frozen=True)
class Token:
    """What the server knows of a token; times in seconds since 1970, None for never."""

    id: str
    sha256: str
    tenant: str
    scopes: tuple[str, ...]
    created: int
    expires: int | None
    revoked: int | None

    @property
    def state(self) -> str:
        """ "valid", "expired" or "revoked"."""
        if self.revoked is not None:
            return "revoked"
        return "expired" if self.expires is not None and time.time() >= self.expires else "valid"


class TokenFile:
    """The tokens of the server with this data directory, which need not run."""

    def __init__(self, data: Path) -> None:
        """Neither reads nor writes yet."""
        self._file = DataFile(data / "tokens.json", "tokens")

    def read(self) -> list[Token]:
        """All tokens, oldest first; InvalidArgumentError for a file that is none of ours."""
        try:
            return [Token(**{**entry, "scopes": tuple(entry["scopes"])}) for entry in self._file.read() or ()]
        except (KeyError, TypeError) as error:
            raise InvalidArgumentError(f"{self._file.path}: {error}") from None

    def create(self, tenant: str, scopes: Sequence[str], lifetime_seconds: float | None) -> tuple[Token, str]:
        """A new token, and the text that clients send: nobody can be told that a second time.

        Args:
            tenant: whose it is, 1 to 32 characters of [a-z0-9-], not '-' first. Tenants see nothing of each other.
            scopes: what it is good for, some of SCOPES.
            lifetime_seconds: None for a token that does not expire.
        """
        if not TENANT_NAME.fullmatch(tenant):
            raise InvalidArgumentError(f'tenant: "{tenant}" is not 1 to 32 characters of [a-z0-9-], not - first')
        unknown = set(scopes) - set(SCOPES)
        if unknown or not scopes:
            raise InvalidArgumentError(f"scopes: some of {', '.join(SCOPES)} are wanted, not {', '.join(unknown)}")
        secret = secrets.token_urlsafe(32)
        now = int(time.time())
        token = Token(
            id=secrets.token_hex(6),
            sha256=hashlib.sha256(secret.encode()).hexdigest(),
            tenant=tenant,
            scopes=tuple(sorted(set(scopes))),
            created=now,
            expires=None if lifetime_seconds is None else now + int(lifetime_seconds),
            revoked=None,
        )
        with self._file.locked():
            self._write([*self.read(), token])
        return token, f"fogbank_{token.id}_{secret}"

    def revoke(self, token_id: str) -> Token:
        """Ends a token within a second; NotFoundError for an unknown one. One that is revoked stays so."""
        with self._file.locked():
            tokens = self.read()
            for index, token in enumerate(tokens):
                if token.id == token_id:
                    if token.revoked is None:
                        tokens[index] = Token(**{**asdict(token), "revoked": int(time.time())})
                        self._write(tokens)
                    return tokens[index]
        raise NotFoundError(f"there is no token {token_id}")

    def _write(self, tokens: Sequence[Token]) -> None:
        self._file.write([asdict(token) for token in tokens])
