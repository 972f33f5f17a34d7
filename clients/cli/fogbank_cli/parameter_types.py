"""Types of command-line values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import click
from fogbank import Window
from fogbank.image import check_image_path
from fogbank.settings import AovName


class SizeType(click.ParamType[tuple[int | None, int | None]]):
    """WxH in pixels; one of them may be left out to follow the scene's aspect ratio."""

    name = "WxH"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int | None, int | None]:
        """Width and height."""
        width, cross, height = str(value).lower().partition("x")
        try:
            size = (int(width) if width else None, int(height) if height else None)
        except ValueError:
            size = (None, None)
        if not cross or size == (None, None) or any(side is not None and side < 1 for side in size):
            self.fail(f"'{value}' is not a size in pixels; write 1280x720, or 1280x or x720", param, ctx)
        return size


class WindowType(click.ParamType[Window]):
    """X,Y,W,H in pixels."""

    name = "X,Y,W,H"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Window:
        """The window."""
        try:
            x, y, width, height = (int(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"'{value}' is not a window in pixels; write X,Y,W,H such as 0,0,640,360", param, ctx)
        return Window(x, y, width, height)


@dataclass(frozen=True)
class Bands:
    """Some of the equal horizontal bands of a film, counted from 1 at the top."""

    first: int
    last: int
    of: int

    def window(self, width: int, height: int) -> Window:
        """Their pixels on a film of this size; UsageError when it has fewer rows than bands."""
        if self.of > height:
            raise click.UsageError(f"--bands: a film of {height} rows has no {self.of} bands")
        top, bottom = ((band * height) // self.of for band in (self.first - 1, self.last))
        return Window(0, top, width, bottom - top)


class BandsType(click.ParamType[Bands]):
    """FIRST-LAST/COUNT, or NUMBER/COUNT."""

    name = "A-B/COUNT"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Bands:
        """The bands."""
        numbers, _, count = str(value).partition("/")
        first, dash, last = numbers.partition("-")
        try:
            bands = Bands(int(first), int(last if dash else first), int(count))
        except ValueError:
            bands = Bands(0, 0, 0)
        if not 1 <= bands.first <= bands.last <= bands.of:
            self.fail(
                f"'{value}' does not name bands; write for example 3-4/16 for the third and fourth of 16", param, ctx
            )
        return bands


class RangeType(click.ParamType[tuple[int, int]]):
    """FIRST-LAST, or one number."""

    name = "A-B"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """First and last."""
        first, dash, last = str(value).partition("-")
        try:
            numbers = int(first), int(last if dash else first)
        except ValueError:
            numbers = -1, -1
        if not 0 <= numbers[0] <= numbers[1]:
            self.fail(f"'{value}' is not a range; write for example 3-7", param, ctx)
        return numbers


class PointType(click.ParamType[tuple[float, float, float]]):
    """X,Y,Z in scene units."""

    name = "X,Y,Z"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        """The point."""
        try:
            x, y, z = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"'{value}' is not a point; write X,Y,Z such as 0.5,-1,2", param, ctx)
        if not all(map(math.isfinite, (x, y, z))):
            self.fail(f"'{value}' is not a point: its coordinates must be finite", param, ctx)
        return x, y, z


class AovsType(click.ParamType[tuple[AovName, ...]]):
    """NAME,NAME,... of additional channels."""

    name = "NAME,..."

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[AovName, ...]:
        """The names, in their order."""
        names: list[AovName] = []
        for text in str(value).split(","):
            known = next((name for name in get_args(AovName) if name == text.strip()), None)
            if known is None:
                self.fail(f"'{text}' is none of {', '.join(get_args(AovName))}", param, ctx)
            names.append(known)
        return tuple(names)


class FramePatternType(click.ParamType[str]):
    """Name of each frame's file with its number as %d or %04d; .exr or .png."""

    name = "FILE%04d.exr"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The pattern."""
        pattern = str(value)
        try:
            distinct = pattern % 0 != pattern % 1
        except (TypeError, ValueError):
            distinct = False
        if not distinct:
            self.fail(f"'{value}' does not number the frames; write for example frames/%04d.exr", param, ctx)
        try:
            check_image_path(Path(pattern % 0))
        except ValueError as error:
            self.fail(str(error), param, ctx)
        return pattern


class SizeInBytesType(click.ParamType[int]):
    """Bytes, with K, M, G or T for powers of 1024."""

    name = "BYTES"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """The number of bytes."""
        text = str(value).upper().removesuffix("B")
        power = "KMGT".find(text[-1:]) + 1 if text else 0
        try:
            size = float(text[:-1] if power else text) * 1024.0**power
        except ValueError:
            size = -1.0
        if not 0.0 <= size < 2.0**63:
            self.fail(f"'{value}' is not a number of bytes; write for example 20G", param, ctx)
        return int(size)


class DurationType(click.ParamType[float]):
    """Seconds, with s, m or h after the number for seconds, minutes and hours."""

    name = "TIME"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Seconds."""
        text = str(value).strip().lower()
        factor = {"s": 1.0, "m": 60.0, "h": 3600.0}.get(text[-1:], 0.0)
        try:
            seconds = float(text[:-1]) * factor if factor else float(text)
        except ValueError:
            seconds = math.nan
        if not (math.isfinite(seconds) and seconds > 0.0):
            self.fail(f"'{value}' is not a time; write for example 90, 90s, 30m or 2h", param, ctx)
        return seconds


class NumbersType(click.ParamType[tuple[float, ...]]):
    """N,N,... all above 0."""

    name = "N,N,..."

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """The numbers, in their order."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        if not numbers or not all(math.isfinite(number) and number > 0.0 for number in numbers):
            self.fail(f"'{value}' is not a list of positive numbers; write for example 1,2,5", param, ctx)
        return numbers


class AssignmentType(click.ParamType[tuple[str, str]]):
    """name=value."""

    name = "NAME=VALUE"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Name and value."""
        if isinstance(value, tuple):
            return value
        name, equals, text = str(value).partition("=")
        if not equals or not name:
            self.fail(f"'{value}' is not of the form NAME=VALUE", param, ctx)
        return name.removeprefix("$"), text


class HostPortType(click.ParamType[tuple[str, int]]):
    """host:port; the port may be left out."""

    name = "HOST:PORT"

    def __init__(self, default_port: int) -> None:
        """`default_port` is taken when the value names none."""
        self._default_port = default_port

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, int]:
        """Host and port."""
        host, colon, port = str(value).rpartition(":")
        if not colon:
            host, port = port, str(self._default_port)
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            self.fail(f"'{value}' is not HOST:PORT", param, ctx)
        return host, int(port)


class ImagePathType(click.ParamType[Path]):
    """A file to write: .exr or .png in a folder that exists; found out before the render, not after."""

    name = "FILE"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path."""
        path = Path(str(value))
        try:
            check_image_path(path)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        if not path.parent.is_dir():
            self.fail(f"{path}: there is no folder {path.parent}", param, ctx)
        if path.is_dir():
            self.fail(f"{path} is a folder", param, ctx)
        return path
