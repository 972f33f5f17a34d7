"""A scene's files on their way to the workers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from distributed import Client, Future

from fogbank.farm.errors import FarmError
from fogbank.farm.parcels import FilePiece
from fogbank.farm.plugin import hold
from fogbank.scene import Scene

# A piece travels in one message of Dask's.
_PIECE_BYTES = 4 << 20


class SceneParcel:
    """Hands the files to Dask, named by their contents, for as long as a worker may lack them.

    Attributes:
        holders: addresses of workers whose servers are known to have the scene.
    """

    def __init__(self, scene: Scene) -> None:
        """FarmError for a scene whose files are not on this machine."""
        if scene.source is None:
            raise FarmError(
                f"the files of {scene.name} are not known here: load the scene with Service.load",
                reason="NO_SCENE_FILES",
            )
        self._source = scene.source
        self.manifest = scene.source.manifest.SerializeToString()
        self.bytes = scene.statistics.file_bytes
        self.holders: set[str] = set()
        self._futures: list[Future[object]] = []

    def futures(self, client: Client, workers: Iterable[str]) -> list[Future[object]]:
        """All pieces, in order, which stay with Dask; none, and Dask forgets them, once all these workers have them."""
        if self.holders.issuperset(workers):
            self.release()
            return []
        futures = self._futures
        if not futures:
            futures = [
                client.submit(hold, piece, key=f"fogbank_file-{piece.sha256}-{piece.offset}")
                for piece in self._pieces()
            ]
            self._futures = futures
        return futures

    def release(self) -> None:
        """Lets Dask forget the files."""
        self._futures = []

    def _pieces(self) -> Iterator[FilePiece]:
        sizes = {entry.sha256: entry.size for entry in self._source.manifest.entries}
        for sha256, size in sizes.items():
            try:
                file = self._source.paths[sha256].open("rb")
            except OSError as error:
                raise FarmError(f"a file of the scene cannot be read: {error}", reason="NO_SCENE_FILES") from None
            with file:
                for offset in range(0, max(size, 1), _PIECE_BYTES):
                    # A file that changes meanwhile has another hash, which the worker's server finds out.
                    yield FilePiece(sha256, size, offset, file.read(min(_PIECE_BYTES, size - offset)))
