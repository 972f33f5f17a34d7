"""Live view in the tev image viewer."""

from __future__ import annotations

import numpy as np
import tevclient
from fogbank import Tile

DEFAULT_PORT = 14158

_CHANNELS = ["R", "G", "B"]


class TevDisplay:
    """An image in a running tev that is filled tile by tile.

    A viewer that goes away must not take the render with it: after a failure the display stays silent, and `failure`
    says why.
    """

    def __init__(self, host: str, port: int, title: str, film_size: tuple[int, int]) -> None:
        """Opens an empty image of the film's width and height; OSError when there is no tev at this address."""
        self._title = title
        self.failure: OSError | None = None
        self._tev = tevclient.Ipc(host, port)
        self._tev.__enter__()
        self._tev.create_image(title, *film_size, channel_names=_CHANNELS)

    def show(self, tile: Tile) -> None:
        """Replaces the pixels of a tile."""
        if self.failure is not None:
            return
        try:
            self._tev.update_image(
                self._title, np.asarray(tile), channel_names=_CHANNELS, x=tile.window.x, y=tile.window.y
            )
        except OSError as error:
            self.failure = error

    def close(self) -> None:
        """Ends the connection; the image stays open in tev."""
        self._tev.__exit__(None, None, None)
