"""Runs clang-tidy on every C++ source of the project that CMake compiles.

    .venv/bin/python tests/tidy.py --build build/release --jobs 2

A source takes seconds, so one that was clean is passed over for as long as nothing it is made of has changed:
its text, the headers that ninja recorded for it, its compile command, the rules and clang-tidy itself. Exit
status 1 on any finding.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import hashlib
import json
import os
import shlex
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CLANG_TIDY = Path(sysconfig.get_path("scripts")) / "clang-tidy"


@dataclass(frozen=True)
class Source:
    """A translation unit, how it is compiled, and the hash of all that its findings depend on."""

    path: Path
    arguments: tuple[str, ...]
    key: str


def dependencies_by_object(build: Path) -> dict[str, list[Path]]:
    """The project's files that each object was made of when it was last compiled, from ninja's log.

    Headers of Debian packages are left out: they change only with their versions, which no finding hangs on.
    """
    command = ["ninja", "-C", str(build), "-t", "deps"]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    result: dict[str, list[Path]] = {}
    current: list[Path] = []
    for line in listing.splitlines():
        if ": #deps" in line:
            current = result.setdefault(line.split(": #deps")[0], [])
        elif line.startswith("    "):
            file = os.path.normpath(build / line.strip())
            if file.startswith(f"{ROOT}{os.sep}"):
                current.append(Path(file))
    return result


def object_of(command: str) -> str:
    words = shlex.split(command)
    return words[words.index("-o") + 1]


def compile_arguments(command: str) -> tuple[str, ...]:
    """What of the command says how the source is read: not the compiler, the source itself and the output."""
    words = shlex.split(command)
    return tuple(
        word
        for at, word in enumerate(words)
        if (word.startswith("-") and word not in ("-o", "-c")) or words[at - 1] == "-isystem"
    )


def sources(build: Path) -> list[Source]:
    """The project's own translation units, each once however many programs it is compiled for (they differ in whether
    failpoints do anything); generated ones lie in the build folder and are left out."""
    dependencies = dependencies_by_object(build)
    rules = (ROOT / ".clang-tidy").read_bytes()
    version = subprocess.run([CLANG_TIDY, "--version"], capture_output=True, check=True).stdout
    contents: dict[Path, bytes] = {}
    result: dict[Path, Source] = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        path = Path(entry["file"])
        if path in result or path.is_relative_to(build) or not path.is_relative_to(ROOT):
            continue
        digest = hashlib.sha256(rules + version + entry["command"].encode())
        for file in sorted({path, *dependencies.get(object_of(entry["command"]), [])}):
            if file not in contents:
                contents[file] = hashlib.sha256(file.read_bytes()).digest() if file.exists() else b"gone"
            digest.update(str(file).encode() + contents[file])
        result[path] = Source(path, compile_arguments(entry["command"]), digest.hexdigest())
    return list(result.values())


def tidy(source: Source, build: Path, clean: Path) -> str | None:
    """Findings as text, or None; a clean source leaves its mark."""
    # The arguments rather than the database, of which clang-tidy takes every entry of a source.
    compiling = [*source.arguments, "-Wno-unknown-warning-option", "-Wno-deprecated-declarations"]
    command = [str(CLANG_TIDY), "--quiet", str(source.path), "--", *compiling]
    run = subprocess.run(command, capture_output=True, text=True, cwd=build)
    if run.returncode == 0 and not run.stdout.strip():
        (clean / source.key).touch()
        return None
    return run.stdout or run.stderr


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, required=True, help="configured and built CMake folder")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("paths", nargs="*", type=Path, help="only these sources (default: all)")
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    only = {path.resolve() for path in arguments.paths}

    clean = build / "tidy"
    clean.mkdir(exist_ok=True)
    todo = [source for source in sources(build) if not (clean / source.key).exists()]
    if only:
        todo = [source for source in todo if source.path in only]
    failures = 0
    with concurrent.futures.ThreadPoolExecutor(max(1, arguments.jobs)) as pool:
        for findings in pool.map(lambda source: tidy(source, build, clean), todo):
            if findings is not None:
                failures += 1
                print(findings, flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
