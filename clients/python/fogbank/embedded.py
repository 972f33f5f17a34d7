"""A server of one's own: started with the client, gone with it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import resource
import shutil
import subprocess
import tempfile
import time
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from fogbank.errors import ServerStartError
from fogbank.paths import DATA_VARIABLE, cache_folder, server_binary

# A server is ready in a fraction of a second; this is for machines that are short of everything.
START_SECONDS = 30.0

# Running jobs get the time to stop and the store to sync; then the process is killed.
STOP_SECONDS = 10.0

# Bytes of a Unix socket's path that every system can take.
_LONGEST_SOCKET_PATH = 103

# The sockets of a process that is being killed close before it can be waited for.
_DYING_SECONDS = 0.5

_POLL_SECONDS = 0.005
_LOG_TAIL_LINES = 15


class DataFolder:
    """The data directory of an embedded server, with a lock that other clients respect.

    A data directory belongs to one server at a time. Without a name the first free one of a pool is taken, so that
    clients side by side do not meet; a named one is taken as it is, and the server says so when it is in use.
    """

    def __init__(self, named: str | os.PathLike[str] | None, pool: Path | None = None) -> None:
        """Takes `named`, else one of `pool`, else $FOGBANK_DATA, else one of the user's cache folder."""
        self.lock: IO[bytes] | None = None
        name = named or (os.environ.get(DATA_VARIABLE) if pool is None else None)
        if name:
            self.path = Path(name).absolute()
            self.path.mkdir(parents=True, exist_ok=True)
            return
        number = 0
        while True:
            self.path = (pool or cache_folder() / "servers") / str(number)
            self.path.mkdir(parents=True, exist_ok=True)
            lock = self.path.with_suffix(".lock").open("wb")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
                number += 1
                continue
            self.lock = lock
            return


class EmbeddedServer:
    """A fogbankd child process that listens on a socket which only this user can reach.

    It ends with `stop`, at the end of the program, and also when the program is killed: its standard input is a pipe
    whose other end dies with the program.

    Attributes:
        target: where it listens, for a channel.
    """

    def __init__(
        self,
        *,
        data: str | os.PathLike[str] | None = None,
        data_pool: Path | None = None,
        scene_root: str | os.PathLike[str] | None = None,
        threads: int | None = None,
        memory_bytes: int | None = None,
    ) -> None:
        """Starts the server and waits until it is ready; ServerStartError with its log's tail if it does not come up.

        Args:
            data: data directory, see `DataFolder`.
            data_pool: folder of data directories of which a free one is taken, unless `data` names one.
            scene_root: folder whose scenes may be loaded by path, without upload.
            threads: worker threads; None for one per core.
            memory_bytes: most private memory; None for no limit.
        """
        binary = server_binary()
        data_folder = DataFolder(data, data_pool)
        self._owner = os.getpid()
        self._folder = _private_folder()
        self._log = self._folder / "log"
        port_file = self._folder / "port"
        self.target = f"unix:{self._folder / 'socket'}"
        command = [str(binary), "--listen", self.target, "--data", str(data_folder.path)]
        command += ["--port-file", str(port_file), "--exit-with-stdin"]
        if scene_root is not None:
            command += ["--scene-root", str(Path(scene_root).absolute())]
        if threads is not None:
            command += ["--threads", str(threads)]
        self._process = self._start(command, data_folder)
        if memory_bytes is not None:
            # Private memory rather than address space, of which allocators and Embree reserve much more than they use.
            with contextlib.suppress(ProcessLookupError):
                resource.prlimit(self._process.pid, resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
        self._finalizer = weakref.finalize(self, _stop, self._process, self._folder, self._owner)
        try:
            self._wait_until_ready(port_file)
        except BaseException:
            self.stop()
            raise

    @property
    def process_id(self) -> int:
        """Of the server."""
        return self._process.pid

    def failure(self) -> ServerStartError | None:
        """Why the server is gone; None while it runs, and in a forked child, which cannot know."""
        if os.getpid() != self._owner:
            return None
        try:
            self._process.wait(_DYING_SECONDS)
        except subprocess.TimeoutExpired:
            return None
        return ServerStartError(self._describe_end("the embedded server died"))

    def stop(self) -> None:
        """Ends the server and waits for it; harmless when repeated, and in a forked child, whose server it is not."""
        self._finalizer()

    def _start(self, command: Sequence[str], data_folder: DataFolder) -> subprocess.Popen[bytes]:
        # The server holds the lock as well, so that the folder stays taken until the last of the two has ended.
        inherited = () if data_folder.lock is None else (data_folder.lock.fileno(),)
        try:
            with self._log.open("wb") as log:
                return subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=log,
                    pass_fds=inherited,
                    # Ctrl-C is for the client, which then cancels its job; it must not stop the server first.
                    start_new_session=True,
                )
        except OSError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise ServerStartError(f"cannot run {command[0]}: {error.strerror}") from None
        finally:
            if data_folder.lock is not None:
                data_folder.lock.close()

    def _wait_until_ready(self, port_file: Path) -> None:
        deadline = time.monotonic() + START_SECONDS
        while not (port_file.exists() and port_file.read_bytes().strip()):
            if self._process.poll() is not None:
                raise ServerStartError(self._describe_end("the embedded server did not come up"))
            if time.monotonic() > deadline:
                raise ServerStartError(
                    self._describe_end(f"the embedded server was not ready after {START_SECONDS:g} s")
                )
            time.sleep(_POLL_SECONDS)

    def _describe_end(self, what: str) -> str:
        status = self._process.poll()
        if status is not None:
            what += f" (signal {-status})" if status < 0 else f" (exit status {status})"
        try:
            lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            lines = []
        return "\n  ".join(
            [what + ("; its log ends with:" if lines else "; its log is empty"), *lines[-_LOG_TAIL_LINES:]]
        )


def _private_folder() -> Path:
    """A new folder (mode 0700) for socket and log: whoever can reach the socket can use the server."""
    folder = Path(tempfile.mkdtemp(prefix="fogbank-"))
    if len(os.fsencode(folder)) + len("/socket") <= _LONGEST_SOCKET_PATH:
        return folder
    folder.rmdir()
    raise ServerStartError(f"{folder.parent} is too long a path for a server's socket; set TMPDIR to a shorter one")


def _stop(process: subprocess.Popen[bytes], folder: Path, owner: int) -> None:
    if os.getpid() != owner:
        return
    if process.stdin is not None:
        process.stdin.close()
    process.terminate()
    try:
        process.wait(STOP_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    shutil.rmtree(folder, ignore_errors=True)
