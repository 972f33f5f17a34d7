"""The committed meshes of scenes/ are what their generator writes."""

from __future__ import annotations

import subprocess
import sys

from tests.oracle.cases import REPOSITORY

GENERATOR = REPOSITORY / "scenes" / "generate.py"


def test_same_bytes_again() -> None:
    result = subprocess.run([sys.executable, str(GENERATOR), "--check"], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_meshes_are_small() -> None:
    """The repository is not a store of meshes: 300 kB each at most."""
    sizes = {path.name: path.stat().st_size for path in REPOSITORY.glob("scenes/*/meshes/*.ply")}
    assert len(sizes) == 12
    assert max(sizes.values()) < 300_000
