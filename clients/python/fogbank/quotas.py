"""What each tenant may use of a server: the file `quotas.json` in its data directory, which the server reads again when
it changes.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from fogbank.data_files import DataFile
from fogbank.errors import InvalidArgumentError, NotFoundError
from fogbank.tokens import TENANT_NAME

EVERYBODY_ELSE = "*"


@dataclass(frozen=True)
class Quota:
    """Most that a tenant may have; None for what the limits of the server allow."""

    jobs: int | None = None
    """Jobs that have not ended."""

    stored_bytes: int | None = None
    """Uploaded files, scenes, images and checkpoints on the disk."""

    cache_bytes: int | None = None
    """Radiance caches on the disk; the least recently used go within a minute when they are above it."""

    watchers: int | None = None
    """Open WatchJob streams."""

    cpu_seconds: float | None = None
    """CPU seconds of render threads in any window."""

    window_seconds: float = 3600.0
    """Length of the window."""


class QuotaFile:
    """The quotas of the server with this data directory, which need not run."""

    def __init__(self, data: Path) -> None:
        """Neither reads nor writes yet."""
        self._file = DataFile(data / "quotas.json", "quotas")

    def read(self) -> dict[str, Quota]:
        """Quotas by tenant, EVERYBODY_ELSE included; InvalidArgumentError for a file that is none of ours."""
        try:
            return {tenant: Quota(**entry) for tenant, entry in (self._file.read() or {}).items()}
        except (TypeError, AttributeError) as error:
            raise InvalidArgumentError(f"{self._file.path}: {error}") from None

    def set(self, tenant: str, quota: Quota) -> None:
        """Sets all of a tenant's quotas; the server takes them within a second.

        Args:
            tenant: a name as tokens have it, or EVERYBODY_ELSE for all without quotas of their own, and for the one
                user of a server that asks nobody who they are.
            quota: numbers of at least 0; the window more than 0.
        """
        if tenant != EVERYBODY_ELSE and not TENANT_NAME.fullmatch(tenant):
            raise InvalidArgumentError(f'tenant: "{tenant}" is not 1 to 32 characters of [a-z0-9-], not - first, or *')
        for name, value in dataclasses.asdict(quota).items():
            if value is not None and not (0 <= value < float("inf")):
                raise InvalidArgumentError(f"{name}: {value} is not a number of at least 0")
        if quota.window_seconds == 0:
            raise InvalidArgumentError("window_seconds: must be more than 0")
        with self._file.locked():
            self._write({**self.read(), tenant: quota})

    def remove(self, tenant: str) -> None:
        """Forgets a tenant's quotas; NotFoundError where there are none."""
        with self._file.locked():
            quotas = self.read()
            if tenant not in quotas:
                raise NotFoundError(f"there are no quotas of {tenant}")
            del quotas[tenant]
            self._write(quotas)

    def _write(self, quotas: dict[str, Quota]) -> None:
        self._file.write({tenant: dataclasses.asdict(quota) for tenant, quota in sorted(quotas.items())})
