"""Arrays of pixels that know where on the film they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fogbank.window import Window


class PixelArray(np.ndarray[tuple[int, int, int], np.dtype[np.float32]]):
    """Read-only float32 array of linear Rec. 709 radiance, shape (height, width, 3).

    Whatever is computed or cut from it is a plain array: it would no longer be what `window` says. Copy it with
    `np.array(pixels)` to change values.

    Attributes:
        window: the pixels' place on the film.
    """

    window: Window

    def __array_finalize__(self, source: npt.NDArray[Any] | None) -> None:
        """Keeps what is known of an array through views and copies of the whole of it."""
        if isinstance(source, PixelArray):
            self.__dict__.update(source.__dict__)

    def __array_wrap__(
        self,
        array: npt.NDArray[Any],
        context: Any = None,  # noqa: ANN401 - as numpy declares it
        return_scalar: bool = False,
    ) -> Any:  # noqa: ANN401 - as numpy declares it
        """Makes results of computations plain arrays or scalars."""
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain

    def __getitem__(self, key: Any) -> Any:  # noqa: ANN401 - as numpy declares it
        """A plain array or scalar."""
        return np.asarray(self)[key]

    def __reduce__(self) -> Any:  # noqa: ANN401 - as numpy declares it
        """Pickles window and the like as well."""
        reduced = super().__reduce__()
        assert isinstance(reduced, tuple)
        reconstruct, arguments, state = reduced
        return reconstruct, arguments, (state, self.__dict__)

    def __setstate__(self, state: Any) -> None:  # noqa: ANN401 - as numpy declares it
        """The reverse of `__reduce__`."""
        array_state, attributes = state
        super().__setstate__(array_state)
        self.__dict__.update(attributes)
        self.flags.writeable = False


class Tile(PixelArray):
    """Pixels of one tile after a pass.

    Attributes:
        window: the tile's place on the film.
        pass_: the pass that it shows, from 0.
        samples_per_pixel: samples in it; the values are their mean.
    """

    pass_: int
    samples_per_pixel: int

    @classmethod
    def create(cls, pixels: npt.NDArray[np.float32], *, window: Window, pass_: int, samples_per_pixel: int) -> Tile:
        """Wraps `pixels` of shape (window.height, window.width, 3) without copying."""
        tile = pixels.view(cls)
        tile.window = window
        tile.pass_ = pass_
        tile.samples_per_pixel = samples_per_pixel
        tile.flags.writeable = False
        return tile


def place(film: npt.NDArray[np.float32], film_window: Window, tile: Tile) -> None:
    """Writes a tile into an array that covers `film_window`, shape (film_window.height, film_window.width, 3)."""
    film[tile.window.relative_to(film_window).slices] = tile
