"""The fake server as a program with the command line of fogbankd, for tests of how servers are started and ended.

A scene root called "fail" makes it fail as a server does that can't use its data directory.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from pathlib import Path

from tests.clients.fake_server import FakeServer


def main() -> int:
    """Serves until told to end."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--listen", required=True)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--scene-root")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--port-file", type=Path)
    parser.add_argument("--exit-with-stdin", action="store_true")
    arguments = parser.parse_args()
    print(f"fogbankd: listening on {arguments.listen}, {arguments.threads} threads", file=sys.stderr, flush=True)
    if arguments.scene_root is not None and arguments.scene_root.endswith("fail"):
        print("fogbankd: error: the data directory is in use by process 4711", file=sys.stderr)
        return 1
    end = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: end.set())
    if arguments.exit_with_stdin:
        threading.Thread(target=_wait_for_stdin, args=(end,), daemon=True).start()
    server = FakeServer()
    port = server.start(arguments.listen)
    if arguments.port_file is not None:
        temporary = arguments.port_file.with_suffix(".new")
        target = arguments.listen if arguments.listen.startswith("unix:") else f"127.0.0.1:{port}"
        temporary.write_text(f"{target}\n")
        temporary.replace(arguments.port_file)
    end.wait()
    server.stop()
    return 0


def _wait_for_stdin(end: threading.Event) -> None:
    while os.read(0, 4096):
        pass
    end.set()


if __name__ == "__main__":
    sys.exit(main())
