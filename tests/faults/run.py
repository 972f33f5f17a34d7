"""The fault tests at full length, in two lanes, since most of them wait: a kill, a timer, a silent network.

    .venv/bin/python tests/faults/run.py

Prints what failed, what took longest, and one table: test, figure, bound, verdict. Exit status 1 if anything failed;
ended by SIGTERM or Ctrl-C it prints the table as far as it has come.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
# About as long as all the others together.
FIRST_LANE = ["test_failpoints.py", "test_store.py", "test_inputs.py"]


def begin(lane: list[str], rows: Path, output: Path) -> subprocess.Popen[bytes]:
    """Some of the files, one after the other; their figures go to `rows`."""
    environment = {**os.environ, "FOGBANK_FAULTS": "full", "FOGBANK_FAULT_ROWS": str(rows)}
    options = ["-q", "-p", "no:cacheprovider", "--durations=6", "--durations-min=20"]
    command = [sys.executable, "-m", "pytest", *options, *(str(FOLDER / name) for name in lane)]
    with output.open("wb") as file:
        return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=file, stderr=file)


def main() -> int:
    """Both lanes, and the table."""
    sys.path.insert(0, str(ROOT))
    from tests.faults.conftest import table

    start = time.monotonic()
    second_lane = sorted(path.name for path in FOLDER.glob("test_*.py") if path.name not in FIRST_LANE)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lanes = [
            begin(lane, folder / f"rows-{number}", folder / f"output-{number}")
            for number, lane in enumerate((FIRST_LANE, second_lane))
        ]
        try:
            codes = [lane.wait() for lane in lanes]
        except KeyboardInterrupt:
            codes = [1]
        finally:
            for lane in lanes:
                if lane.poll() is None:
                    lane.send_signal(signal.SIGINT)  # fixtures end their servers
                    lane.wait()
            for path in sorted(folder.glob("output-*")):
                print(path.read_text(errors="replace"))
            lines = [line for path in sorted(folder.glob("rows-*")) for line in path.read_text().splitlines()]
            print("\n".join(table([json.loads(line) for line in lines])))
            print(f"fault tests took {time.monotonic() - start:.0f} s", flush=True)
    return 1 if any(codes) else 0


if __name__ == "__main__":
    sys.exit(main())
