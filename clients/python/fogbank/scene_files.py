"""The local files of a scene that is being pushed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fogbank._generated.v1 import scene_pb2
from fogbank.errors import InvalidSceneError
from fogbank.hash_cache import HashCache


@dataclass(frozen=True)
class LocalFile:
    """One file of a scene."""

    logical_path: str
    """Relative to the scene's root, with '/' between the parts."""

    path: Path
    """Where it is on this machine."""

    sha256: str
    """Of its contents, 64 lower-case hexadecimal digits."""

    size: int
    """Bytes."""


class SceneFiles:
    """The files below one root folder that a scene is known to use. Nothing outside the root is ever read.

    Args:
        main: the scene's XML file.
        root: folder that holds every file of the scene; the XML file's own folder when None.
        hash_cache: where sums of files are kept.
    """

    def __init__(self, main: Path, root: Path | None, hash_cache: HashCache) -> None:
        """Raises InvalidSceneError when the XML file is missing or not below the root."""
        self._hash_cache = hash_cache
        self._files: dict[str, LocalFile] = {}
        main = Path(os.path.abspath(main))  # noqa: PTH100 - resolve() would follow links before the root is known
        self.root = main.parent if root is None else Path(root).resolve()
        if root is not None:
            main = main.parent.resolve() / main.name
        if not main.is_relative_to(self.root):
            raise InvalidSceneError(f"{main} is not below the scene's root {self.root}")
        self.main_path = main.relative_to(self.root).as_posix()
        if not self.add(self.main_path):
            raise InvalidSceneError(f"{main}: no such file")

    @property
    def files(self) -> list[LocalFile]:
        """All files known so far, the XML file first."""
        return list(self._files.values())

    def by_sha256(self, sha256: str) -> LocalFile | None:
        """A file with these contents."""
        return next((file for file in self._files.values() if file.sha256 == sha256), None)

    def add(self, logical_path: str) -> bool:
        """Adds a file if it exists below the root; False when there is no such file.

        Raises InvalidSceneError for a path that leaves the root, also by a symbolic link, and for an unreadable file.
        """
        parts = PurePosixPath(logical_path)
        path = self.root / parts
        if parts.is_absolute() or ".." in parts.parts or not path.resolve().is_relative_to(self.root.resolve()):
            raise InvalidSceneError(
                f"{self.main_path}: {logical_path} lies outside the scene's root {self.root}; if that is meant, name"
                " a folder that holds all files of the scene as the root (root=... or --root)"
            )
        if not path.is_file():
            return False
        try:
            sha256, size = self._hash_cache.sha256(path)
        except OSError as error:
            raise InvalidSceneError(f"cannot read {path}: {error.strerror}") from None
        self._files[logical_path] = LocalFile(logical_path, path, sha256, size)
        return True

    def hash_again(self, file: LocalFile) -> bool:
        """Hashes a file anew because its contents turned out to be others; True when the sum did change."""
        self._hash_cache.forget(file.path)
        self.add(file.logical_path)
        return self._files[file.logical_path].sha256 != file.sha256

    def manifest(self, options: scene_pb2.LoadOptions) -> scene_pb2.SceneManifest:
        """The wire form of all files known so far."""
        return scene_pb2.SceneManifest(
            main_path=self.main_path,
            entries=[
                scene_pb2.ManifestEntry(path=file.logical_path, sha256=file.sha256, size=file.size)
                for file in self._files.values()
            ],
            options=options,
        )
