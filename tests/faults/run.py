"""The fault tests at full length, in two lanes, since most of them wait: a kill, a timer, a silent network.

    .venv/bin/python tests/faults/run.py

Prints what failed and one table: test, figure, bound, verdict. Exit status 1 if anything failed.
"""

from __future__ import annotations

import concurrent.futures
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
# About as long as all the others together.
FIRST_LANE = ["test_failpoints.py", "test_store.py", "test_inputs.py"]


def run(lane: list[str], rows: Path) -> subprocess.CompletedProcess[str]:
    """Some of the files, one after the other; their figures go to `rows`."""
    environment = {**os.environ, "FOGBANK_FAULTS": "full", "FOGBANK_FAULT_ROWS": str(rows)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(str(FOLDER / name) for name in lane)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def main() -> int:
    """Both lanes, and the table."""
    sys.path.insert(0, str(ROOT))
    from tests.faults.conftest import table

    start = time.monotonic()
    second_lane = sorted(path.name for path in FOLDER.glob("test_*.py") if path.name not in FIRST_LANE)
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(2) as pool:
        files = [Path(folder) / "first", Path(folder) / "second"]
        lanes = list(pool.map(run, (FIRST_LANE, second_lane), files))
        rows = [row for file in files if file.exists() for row in json.loads(file.read_text())]
    for lane in lanes:
        print(lane.stdout if lane.returncode else lane.stdout.rstrip().rpartition("\n")[2])
    print("\n".join(table(rows)))
    print(f"fault tests took {time.monotonic() - start:.0f} s")
    return 1 if any(lane.returncode for lane in lanes) else 0


if __name__ == "__main__":
    sys.exit(main())
