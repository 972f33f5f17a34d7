"""The stores without a server (store/): every N-th call to the kernel fails, single bits turn. Faults C3, C5, C6."""

from __future__ import annotations

import os
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from fogbank.paths import server_binary

from tests.faults.conftest import FULL, Record

PROGRAM = Path(server_binary()).with_name("store_faults_test")
# On a disk of memory: what a disk does with a sync is not what is tested.
MEMORY = Path("/dev/shm")


def run(tmp_path: Path, tests: str) -> ElementTree.Element:
    """The results of some tests of the program, which must pass."""
    report = tmp_path / "report.xml"
    size = {"FOGBANK_FAULT_CALLS": "1000000", "FOGBANK_BIT_FLIPS": "1000"} if FULL else {}
    folder = {"TMPDIR": str(MEMORY)} if MEMORY.is_dir() else {}
    done = subprocess.run(
        [PROGRAM, f"--gtest_filter={tests}", f"--gtest_output=xml:{report}", "--gtest_brief=1"],
        env={**os.environ, **size, **folder},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    return ElementTree.parse(report).getroot()


def numbers(report: ElementTree.Element, name: str) -> list[int]:
    """A property of each test."""
    return [int(item.attrib["value"]) for item in report.iter("property") if item.attrib["name"] == name]


@pytest.mark.timeout(700)
def test_every_call_fails_once(tmp_path: Path, record: Record) -> None:
    report = run(tmp_path, "Faults/NthCall.*")
    assert len(numbers(report, "calls")) == 5
    record("calls to the kernel, each failing in 5 ways", -min(numbers(report, "tried")), -60 if FULL else -5)
    record("acknowledged and lost, or errors without a reason", 0, 0)


def test_bit_flips(tmp_path: Path, record: Record) -> None:
    report = run(tmp_path, "BitFlips.*")
    (found,) = numbers(report, "found")
    (harmless,) = numbers(report, "harmless")
    record("bits flipped", -(found + harmless), -1000 if FULL else -60)
    record("of them in unused bytes of the database, %", 100 * harmless / (found + harmless), 20)
    record("of them unnoticed in what was read", 0, 0)
    assert found > harmless
