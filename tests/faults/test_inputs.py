"""What other programs of the tests do in great number, as rows of the table: mutated files, path traversals, tokens.

`make test` runs these programs as they are, and shorter; faults F1, F2, F9, A1.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from fogbank.paths import server_binary

from tests.faults.conftest import FULL, Record
from tests.fuzz.run import CORPUS, WHOLE_SERVER, run

ROOT = Path(__file__).resolve().parents[2]
TARGETS = ROOT / "build" / "fuzz" / "fuzz"
MUTATIONS = 20_000
MUTATIONS_OF_REQUESTS = 1_000  # several calls each, of the whole server
PATH_TRAVERSALS = 40

pytestmark = pytest.mark.skipif(not FULL, reason="make test runs these programs by themselves")


@pytest.mark.parametrize("target", sorted(folder.name for folder in CORPUS.iterdir()))
def test_mutated_files(tmp_path: Path, record: Record, target: str) -> None:
    """With AddressSanitizer and UndefinedBehaviorSanitizer: refused, or read back the same."""
    if not (TARGETS / target).exists():
        pytest.skip("NOT TESTED: the fuzz targets are not built (make test-faults builds them)")
    mutations = MUTATIONS_OF_REQUESTS if target in WHOLE_SERVER else MUTATIONS
    outcome = run(TARGETS / target, [f"-runs={mutations}", "-seed=1"], tmp_path)
    record(f"mutations of {target}", -outcome.inputs, -mutations)
    record("deaths, or differences in silence", not outcome.passed, 0)
    assert outcome.passed, outcome.output[-6000:]
    assert outcome.inputs >= mutations


def test_path_traversals(record: Record) -> None:
    command = [str(Path(server_binary()).with_name("scene_test")), "--gtest_filter=*PathTraversal*"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    passed = int(re.findall(r"PASSED\s*\] (\d+) tests", done.stdout)[0])
    record("paths that lead outside, all refused", -passed, -PATH_TRAVERSALS)
    assert passed >= PATH_TRAVERSALS


def test_authentication_of_every_rpc(record: Record) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "tests/service/test_security.py", "-k", "asks_who_calls"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    record("rpcs in the matrix of tokens", -int(re.findall(r"(\d+) passed", done.stdout)[0]), -25)
