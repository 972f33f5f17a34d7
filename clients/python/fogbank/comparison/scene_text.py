"""The scene as every method of a comparison gets it: one film size, filter box, parameters filled in.

With any other filter Mitsuba weights the samples of neighbouring pixels: noise is then correlated, which denoisers
can't cope with. The XML is changed as text, so that line numbers in error messages stay those of the user's file.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from fogbank.errors import InvalidSceneError

_FILM = re.compile(r"<film\b(?P<attributes>[^>]*?)(?:/>|>(?P<body>.*?)</film>)", re.DOTALL)
_FILTER = re.compile(r"<rfilter\b[^>]*?/>|<rfilter\b.*?</rfilter>", re.DOTALL)
_SIZE = re.compile(r'<integer\b[^>]*\bname\s*=\s*"(?:width|height|crop_[a-z_]+)"[^>]*/>')
_DEFAULT = re.compile(r'<default\b[^>]*\bname\s*=\s*"(?P<name>[^"]*)"[^>]*/>')


def prepare_parameters(text: str, parameters: Mapping[str, str]) -> str:
    """The XML with these `$` values as its defaults; InvalidSceneError for one that it has no default of."""
    unknown = set(parameters) - {match["name"] for match in _DEFAULT.finditer(text)}
    if unknown:
        raise InvalidSceneError(f"the scene has no <default> named {sorted(unknown)[0]}")

    def default(match: re.Match[str]) -> str:
        name = match["name"]
        return (
            f"<default name={quoteattr(name)} value={quoteattr(parameters[name])}/>" if name in parameters else match[0]
        )

    return _DEFAULT.sub(default, text)


def prepare_text(text: str, size: tuple[int, int], parameters: Mapping[str, str]) -> str:
    """The XML with this film size (width, height), without crop window, with the filter box and these `$` values."""

    def film(match: re.Match[str]) -> str:
        body = _SIZE.sub("", _FILTER.sub("", match["body"] or ""))
        width, height = size
        return (
            f'<film{match["attributes"]}><integer name="width" value="{width}"/>'
            f'<integer name="height" value="{height}"/><rfilter type="box"/>{body}</film>'
        )

    prepared, films = _FILM.subn(film, prepare_parameters(text, parameters))
    if films == 0:
        raise InvalidSceneError("the scene has no <film> in its XML file; a comparison needs one to set its size")
    return prepared


def film_size(text: str) -> tuple[int, int]:
    """Width and height that the XML asks for; (768, 576), the default of Mitsuba and Fogbank, where it doesn't."""
    tree = ElementTree.fromstring(text)
    values = dict(_values(tree))
    size = {"width": 768, "height": 576}
    for element in tree.iterfind(".//film/integer"):
        if (name := element.get("name", "")) in size:
            size[name] = int(_expanded(element.get("value", ""), values))
    return size["width"], size["height"]


def choose_size(
    path: Path, parameters: Mapping[str, str], size: tuple[int | None, int | None] | None
) -> tuple[int, int]:
    """Width and height: those given, one of them following from the scene's shape, else the scene's own."""
    try:
        width, height = film_size(prepare_parameters(path.read_text(encoding="utf-8"), parameters))
    except (ElementTree.ParseError, ValueError) as error:
        raise InvalidSceneError(f"{path}: {error}") from None
    wide, high = size or (width, height)
    return wide or max(1, round((high or 0) * width / height)), high or max(1, round((wide or 0) * height / width))


def mitsuba_rr_depth(text: str) -> int:
    """Where the scene file has Russian roulette begin; 5, Mitsuba's default, where it doesn't say."""
    tree = ElementTree.fromstring(text)
    for element in tree.iterfind("./integrator//integer"):
        if element.get("name") == "rr_depth":
            return int(_expanded(element.get("value", ""), dict(_values(tree))))
    return 5


def prepare_scene(path: Path, folder: Path, size: tuple[int, int], parameters: Mapping[str, str]) -> Path:
    """Writes the prepared XML and the files that it names below `folder`; returns the path of the XML.

    Files are linked where the file system can, else copied. Raises InvalidSceneError for XML that can't be parsed and
    for files outside the scene's folder, OSError for files that can't be read.
    """
    source = path.resolve().parent
    target = folder / path.name
    folder.mkdir(parents=True, exist_ok=True)
    try:
        original = path.read_text(encoding="utf-8")
        ElementTree.fromstring(original)  # text that is no XML is not worth changing
        text = prepare_text(original, size, parameters)
        target.write_text(text, encoding="utf-8")
        _bring_files(ElementTree.fromstring(text), source, folder)
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise InvalidSceneError(f"{path}: {error}") from None
    return target


def _bring_files(tree: ElementTree.Element, source: Path, folder: Path) -> None:
    values = dict(_values(tree))
    for name in sorted({_expanded(found, values) for found in _file_names(tree)}):
        original = source / name
        if not original.is_file():
            continue  # whoever loads the scene says so, with the line
        if Path(name).is_absolute() or not original.resolve().is_relative_to(source):
            raise InvalidSceneError(f"{name} lies outside the scene's folder {source}; a comparison needs it inside")
        copy = folder / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if not copy.exists():
            _link_or_copy(original, copy)
        if original.suffix.lower() == ".xml":
            _bring_files(ElementTree.parse(original).getroot(), source, folder)


def _file_names(tree: ElementTree.Element) -> list[str]:
    named = [e.get("value", "") for e in tree.iterfind(".//string") if e.get("name") == "filename"]
    return named + [e.get("filename", "") for e in tree.iter() if e.get("filename")]


def _values(tree: ElementTree.Element) -> list[tuple[str, str]]:
    return [(e.get("name", ""), e.get("value", "")) for e in tree.iterfind(".//default")]


def _expanded(text: str, values: Mapping[str, str]) -> str:
    """With `$name` replaced; the longest name first, as one may begin like another."""
    for name in sorted(values, key=len, reverse=True):
        text = text.replace(f"${name}", values[name])
    return text


def _link_or_copy(original: Path, copy: Path) -> None:
    try:
        os.link(original.resolve(), copy)
    except OSError:
        shutil.copyfile(original, copy)
