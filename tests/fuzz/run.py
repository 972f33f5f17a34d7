"""Runs the fuzz targets: each over its committed corpus, then over mutations of it.

    .venv/bin/python tests/fuzz/run.py --build build/fuzz --runs 4000          the same inputs every time: `make test`
    .venv/bin/python tests/fuzz/run.py --build build/fuzz --seconds 600        new inputs every time: `make fuzz`

What is found lies in out/fuzz, and goes into the target's corpus together with the fix. Exit status 1 if anything was.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests" / "fuzz" / "corpus"
# Of one input: far above what any reader takes for so few bytes.
LIMITS = ["-timeout=10", "-rss_limit_mb=1024", "-malloc_limit_mb=512", "-max_len=8192"]
# Targets that are the whole server take minutes to build, and one input of theirs is several calls: not for
# `make test`, where tests/faults/test_requests.py sends their corpus to the ordinary server. The later limits count.
WHOLE_SERVER = {"request": ["-timeout=60", "-rss_limit_mb=4096"]}


@dataclass(frozen=True)
class Outcome:
    """One target's run."""

    target: str
    inputs: int
    seconds: float
    output: str
    passed: bool


def run(program: Path, extent: list[str], found: Path) -> Outcome:
    """Runs one target. New inputs that reach new code are kept beside what it finds, for the next run."""
    target = program.name
    limits = [*LIMITS, *WHOLE_SERVER.get(target, [])]
    command = [str(program), *limits, *extent, f"-artifact_prefix={found}/{target}-", "-print_final_stats=1"]
    dictionary = CORPUS.parent / f"{target}.dict"
    if dictionary.exists():
        command.append(f"-dict={dictionary}")
    with tempfile.TemporaryDirectory() as empty:
        # The first folder is written to; with a fixed seed the run must not depend on the ones before.
        grown = Path(empty) if "-seed=1" in extent else found / "corpus" / target
        grown.mkdir(parents=True, exist_ok=True)
        start = time.monotonic()
        process = subprocess.run(
            [*command, str(grown), str(CORPUS / target)], capture_output=True, text=True, errors="replace", check=False
        )
    count = re.search(r"number_of_executed_units:\s*(\d+)", process.stderr)
    return Outcome(
        target,
        int(count[1]) if count else 0,
        time.monotonic() - start,
        process.stdout + process.stderr,
        process.returncode == 0,
    )


def main() -> int:
    """Runs all targets that were built, or those named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", help="by default all, those of the whole server only with --seconds")
    parser.add_argument("--build", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    extent = parser.add_mutually_exclusive_group()
    extent.add_argument("--runs", type=int, default=4000, help="mutations of each target, with a fixed seed")
    extent.add_argument("--seconds", type=int, help="of each target, with a new seed")
    arguments = parser.parse_args()

    known = sorted(folder.name for folder in CORPUS.iterdir())
    wanted = arguments.targets or [name for name in known if arguments.seconds or name not in WHOLE_SERVER]
    limit = [f"-max_total_time={arguments.seconds}"] if arguments.seconds else [f"-runs={arguments.runs}", "-seed=1"]
    found = ROOT / "out" / "fuzz"
    found.mkdir(parents=True, exist_ok=True)
    failures = 0
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        programs = [arguments.build / "fuzz" / target for target in wanted]
        for outcome in pool.map(lambda program: run(program, limit, found), programs):
            verdict = "ok" if outcome.passed else "FAILED"
            print(f"{outcome.target:<12}{outcome.inputs:>9} inputs{outcome.seconds:>8.1f} s  {verdict}", flush=True)
            if not outcome.passed:
                failures += 1
                print(outcome.output[-6000:])
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
