"""Generates the Python stubs of proto/fogbank into the package fogbank._generated.

    .venv/bin/python clients/python/generate_stubs.py

Does nothing when nothing has changed: a stamp holds the hash of the .proto files, of this script and of the
generators' versions. `proto/fogbank/v1/x.proto` becomes `fogbank._generated.v1.x_pb2`.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import re
import shutil
import sys
import tempfile
from importlib import resources
from pathlib import Path

from grpc_tools import protoc

ROOT = Path(__file__).resolve().parents[2]
PROTO_ROOT = ROOT / "proto"
PACKAGE = Path(__file__).resolve().parent / "fogbank" / "_generated"
STAMP = PACKAGE / ".stamp"


def _fingerprint(protos: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in [*protos, Path(__file__)]:
        digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    for generator in ("grpcio-tools", "mypy-protobuf"):
        digest.update(importlib.metadata.version(generator).encode() + b"\0")
    return digest.hexdigest()


def _relocate(source: str, *, is_stub: bool) -> str:
    """Rewrites imports of `fogbank.v1` to where the stubs really are.

    protoc derives Python module names from the .proto path and has no option for it. In .py files only import
    lines may change: descriptors and method names also contain "fogbank.v1", and there it is the wire name.
    """
    source = re.sub(r"^from fogbank\.v1 import ", "from fogbank._generated.v1 import ", source, flags=re.MULTILINE)
    if is_stub:
        source = re.sub(r"\bfogbank\.v1\.(?=\w+_pb2)", "fogbank._generated.v1.", source)
    return source


def main() -> int:
    protos = sorted((PROTO_ROOT / "fogbank").rglob("*.proto"))
    if not protos:
        print(f"generate_stubs: error: no .proto files below {PROTO_ROOT / 'fogbank'}", file=sys.stderr)
        return 1
    fingerprint = _fingerprint(protos)
    if STAMP.is_file() and STAMP.read_text() == fingerprint:
        return 0

    well_known = resources.files("grpc_tools") / "_proto"
    with tempfile.TemporaryDirectory() as name:
        output = Path(name)
        arguments = [
            "protoc",
            f"--proto_path={PROTO_ROOT}",
            f"--proto_path={well_known}",
            f"--python_out={output}",
            f"--grpc_python_out={output}",
            f"--plugin=protoc-gen-mypy={Path(sys.executable).with_name('protoc-gen-mypy')}",
            f"--plugin=protoc-gen-mypy_grpc={Path(sys.executable).with_name('protoc-gen-mypy_grpc')}",
            f"--mypy_out=quiet:{output}",
            f"--mypy_grpc_out=quiet:{output}",
            *(str(path.relative_to(PROTO_ROOT)) for path in protos),
        ]
        status = protoc.main(arguments)
        if status != 0:
            return int(status)
        generated = output / "fogbank"
        for path in [*generated.rglob("*.py"), *generated.rglob("*.pyi")]:
            path.write_text(_relocate(path.read_text(), is_stub=path.suffix == ".pyi"))
        for folder in [generated, *(path for path in generated.rglob("*") if path.is_dir())]:
            (folder / "__init__.py").touch()
        shutil.rmtree(PACKAGE, ignore_errors=True)
        shutil.copytree(generated, PACKAGE)
    STAMP.write_text(fingerprint)
    return 0


if __name__ == "__main__":
    sys.exit(main())
