"""Pictures of windows of one film, put together."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR

from fogbank.errors import InvalidArgumentError
from fogbank.image import Image
from fogbank.window import Window

_SETTINGS = "fogbank:settings"

# What parts of one picture have in common, besides the settings.
_SHARED = ("fogbank:scene", "fogbank:integrator", "fogbank:seed", "fogbank:samples_per_pixel", "fogbank:version")

# What the whole has the sum of.
_SUMS = ("fogbank:rays", "fogbank:samples", "fogbank:render_cpu_seconds")

Channels = dict[str, npt.NDArray[Any]]


def join_images(parts: Mapping[str, bytes], window: Window | None = None) -> Image:
    """Puts together pictures of windows of one film: the same pixels, bit for bit, as one picture of all of them.

    Args:
        parts: EXR files of the server, by name; they may overlap.
        window: what they have to cover; the whole film when None.

    The header says what the parts agree on; rays, samples and CPU seconds are sums. Raises InvalidArgumentError,
    naming the part, when one is of another picture (scene, settings, seed, samples, channels) or differs where two
    overlap, and when they leave pixels uncovered; DataLossError for one that is damaged.
    """
    if not parts:
        raise InvalidArgumentError("there are no parts to join")
    # In an order of their own, so that the header doesn't depend on that of the arguments.
    pieces = sorted((_read(name, data) for name, data in parts.items()), key=lambda piece: (piece.window, piece.name))
    first = pieces[0]
    whole = window or Window(0, 0, *first.film_size)
    for piece in pieces[1:]:
        _check_same_picture(first, piece)
    canvas = {
        name: np.zeros((whole.height, whole.width, *values.shape[2:]), values.dtype)
        for name, values in first.channels.items()
    }
    owner = np.full((whole.height, whole.width), -1)
    for number in range(len(pieces)):
        _paint(canvas, owner, whole, number, pieces)
    missing = int(np.count_nonzero(owner < 0))
    if missing:
        row, column = np.argwhere(owner < 0)[0].tolist()
        raise InvalidArgumentError(
            f"the parts leave {missing} pixels uncovered, the first at {column + whole.x}, {row + whole.y}"
        )
    return Image.from_exr(_encode(canvas, _header(pieces, whole)))


@dataclass(frozen=True)
class _Piece:
    """One part."""

    name: str
    window: Window
    film_size: tuple[int, int]
    channels: Channels
    header: dict[str, Any]
    metadata: dict[str, Any]

    def settings(self) -> dict[str, Any]:
        """Of its render, without its window."""
        settings: dict[str, Any] = json.loads(self.metadata.get(_SETTINGS, "{}"))
        settings.get("film", {}).pop("crop", None)
        return settings


def _read(name: str, data: bytes) -> _Piece:
    image = Image.from_exr(data)
    with OpenEXR.File(io.BytesIO(data)) as file:
        header = dict(file.header())
        channels = {channel: np.array(values.pixels) for channel, values in file.channels().items()}
    return _Piece(name, image.window, image.film_size, channels, header, image.metadata)


def _check_same_picture(first: _Piece, other: _Piece) -> None:
    def refuse(what: str, here: object, there: object) -> None:
        if here != there:
            raise InvalidArgumentError(
                f"{other.name} is not of the picture that {first.name} is of: its {what} is {there}, not {here}"
            )

    refuse("film", first.film_size, other.film_size)
    for key in _SHARED:
        refuse(key.removeprefix("fogbank:"), first.metadata.get(key), other.metadata.get(key))
    here, there = first.settings(), other.settings()
    for key in sorted(here.keys() | there.keys()):
        refuse(f"setting {key}", here.get(key), there.get(key))
    kinds = [{name: str(values.dtype) for name, values in piece.channels.items()} for piece in (first, other)]
    refuse("list of channels", *kinds)


def _paint(canvas: Channels, owner: npt.NDArray[np.int_], whole: Window, number: int, pieces: Sequence[_Piece]) -> None:
    piece = pieces[number]
    place = piece.window.relative_to(whole)
    if place.x < 0 or place.y < 0 or place.x + place.width > whole.width or place.y + place.height > whole.height:
        raise InvalidArgumentError(f"{piece.name} lies outside of the window that is to be covered")
    there = owner[place.slices]
    taken = there >= 0
    for name, values in piece.channels.items():
        target = canvas[name][place.slices]
        # As bits: what is equal must be so down to the sign of a zero.
        differs = np.any(np.atleast_3d(_bits(target) != _bits(values)), axis=2) & taken
        if np.any(differs):
            other = pieces[int(there[differs][0])].name
            raise InvalidArgumentError(f"{piece.name} and {other} differ where they overlap")
        target[...] = values
    there[...] = number


def _bits(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.ascontiguousarray(values).view(np.uint16 if values.dtype.itemsize == 2 else np.uint32)


def _header(pieces: Sequence[_Piece], whole: Window) -> dict[str, Any]:
    first = pieces[0]
    metadata = {
        key: value
        for key, value in first.metadata.items()
        if all(str(piece.metadata.get(key)) == str(value) for piece in pieces)
    }
    for key in _SUMS:
        if all(key in piece.metadata for piece in pieces):
            total = sum(float(piece.metadata[key]) for piece in pieces)
            metadata[key] = f"{total:.6f}" if key.endswith("seconds") else str(round(total))
    if _SETTINGS in first.metadata:
        settings = first.settings()
        settings["film"] = {**settings.get("film", {}), "crop": list(whole)}
        metadata[_SETTINGS] = json.dumps(settings, separators=(",", ":"))
    return {
        **metadata,
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "displayWindow": first.header["displayWindow"],
        "dataWindow": (
            np.array([whole.x, whole.y], np.int32),
            np.array([whole.x + whole.width - 1, whole.y + whole.height - 1], np.int32),
        ),
    }


def _encode(channels: Channels, header: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    with OpenEXR.File(header, channels) as exr:
        exr.write(file)
    return file.getvalue()
