"""Remembers SHA-256 sums of local files, so that pushing a scene again reads only what changed."""

from __future__ import annotations

import hashlib
import os
import sqlite3
import threading
import time
from dataclasses import dataclass
from pathlib import Path

# A file that was written less than this before it was hashed may be written again within the same tick of the file
# system's clock, and would then look unchanged; such sums are not kept.
SETTLING_NANOSECONDS = 2_000_000_000

_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class FileIdentity:
    """What tells, without reading it, that a file is the one that was hashed."""

    size: int
    """Bytes."""

    mtime_ns: int
    """Time of the last change of the contents, nanoseconds."""

    ctime_ns: int
    """Time of the last change of anything, nanoseconds; catches tools that set mtime back."""

    inode: int
    """Number of the file in its file system."""

    @classmethod
    def of(cls, status: os.stat_result) -> FileIdentity:
        """The identity by a stat call."""
        return cls(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


class HashCache:
    """Path and identity -> SHA-256, in an SQLite file that several processes may share.

    It only saves time: whatever happens to its file, sums are computed anew. The server checks every sum.
    """

    def __init__(self, path: Path) -> None:
        """Opens or creates the file; without a writable place the sums are kept in memory."""
        self._lock = threading.Lock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = self._open(str(path))
        except (OSError, sqlite3.Error):
            self._database = self._open(":memory:")

    def sha256(self, path: Path) -> tuple[str, int]:
        """SHA-256 (64 lower-case hexadecimal digits) and size in bytes of a regular file."""
        key = str(path.resolve())
        with path.open("rb") as file:
            identity = FileIdentity.of(os.fstat(file.fileno()))
            known = self._look_up(key, identity)
            if known is not None:
                return known, identity.size
            started_ns = time.time_ns()
            digest = hashlib.sha256()
            size = 0
            while block := file.read(_READ_BYTES):
                digest.update(block)
                size += len(block)
            unchanged = FileIdentity.of(os.fstat(file.fileno())) == identity
        settled = started_ns - max(identity.mtime_ns, identity.ctime_ns) >= SETTLING_NANOSECONDS
        if unchanged and settled:
            self._remember(key, identity, digest.hexdigest())
        return digest.hexdigest(), size

    def forget(self, path: Path) -> None:
        """Drops what is known of a file, because the server found another sum."""
        with self._lock, self._database:
            self._database.execute("DELETE FROM hashes WHERE path = ?", (str(path.resolve()),))

    def close(self) -> None:
        """Closes the file."""
        with self._lock:
            self._database.close()

    @staticmethod
    def _open(name: str) -> sqlite3.Connection:
        # The lock of this class replaces sqlite3's rule of one thread per connection.
        database = sqlite3.connect(name, timeout=5.0, check_same_thread=False)
        with database:
            database.execute(
                "CREATE TABLE IF NOT EXISTS hashes (path TEXT PRIMARY KEY, size INTEGER NOT NULL,"
                " mtime_ns INTEGER NOT NULL, ctime_ns INTEGER NOT NULL, inode INTEGER NOT NULL,"
                " sha256 TEXT NOT NULL)"
            )
        return database

    def _look_up(self, key: str, identity: FileIdentity) -> str | None:
        with self._lock:
            row = self._database.execute(
                "SELECT sha256 FROM hashes WHERE path = ? AND size = ? AND mtime_ns = ? AND ctime_ns = ? AND inode = ?",
                (key, identity.size, identity.mtime_ns, identity.ctime_ns, identity.inode),
            ).fetchone()
        return None if row is None else str(row[0])

    def _remember(self, key: str, identity: FileIdentity, sha256: str) -> None:
        with self._lock, self._database:
            self._database.execute(
                "INSERT OR REPLACE INTO hashes VALUES (?, ?, ?, ?, ?, ?)",
                (key, identity.size, identity.mtime_ns, identity.ctime_ns, identity.inode, sha256),
            )
