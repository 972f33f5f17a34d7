"""Rectangles of pixels."""

from __future__ import annotations

from typing import NamedTuple

from fogbank._generated.v1 import scene_pb2


class Window(NamedTuple):
    """A rectangle of pixels in film coordinates, half-open: x <= column < x + width; rows count downwards from 0."""

    x: int
    y: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns, to index an array of the whole film: `film[window.slices] = tile`."""
        return slice(self.y, self.y + self.height), slice(self.x, self.x + self.width)

    def relative_to(self, other: Window) -> Window:
        """The same pixels, counted from the upper left corner of `other`."""
        return self._replace(x=self.x - other.x, y=self.y - other.y)

    def to_message(self) -> scene_pb2.Window:
        """The wire form."""
        return scene_pb2.Window(x=self.x, y=self.y, width=self.width, height=self.height)

    @classmethod
    def from_message(cls, message: scene_pb2.Window) -> Window:
        """The window of a wire message."""
        return cls(message.x, message.y, message.width, message.height)
