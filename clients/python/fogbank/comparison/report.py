"""The report: report.html, which holds everything it shows, and the same pictures and plots as files."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from PIL import Image

from fogbank.comparison import analysis, pictures
from fogbank.comparison.image_error import read, resolution
from fogbank.comparison.pictures import Colours, Toning
from fogbank.comparison.plots import error_plot
from fogbank.comparison.references import Reference
from fogbank.window import Window

_TEMPLATE = "report.html.jinja"
_MOST_BUDGETS = 3
"""Whose pictures the report holds: the first, a middle one, the last."""
_REFERENCE = "reference"
_HEADINGS: dict[analysis.Cost, str] = {
    "records": "Records to an error",
    "cpu_seconds": "CPU time to an error",
    "wall_seconds": "Wall-clock time to an error",
}


@dataclass(frozen=True)
class Report:
    """What is reported."""

    folder: Path
    scene: str
    methods: Sequence[str]
    base: str
    by_records: bool
    results: pd.DataFrame
    means: pd.DataFrame
    costs: Mapping[analysis.Cost, pd.DataFrame]
    split: pd.DataFrame
    images: Mapping[tuple[str, float, int], Path]
    reference: Reference
    insets: Sequence[Window] | None
    facts: Mapping[str, str]
    settings: Mapping[str, Any]
    command: str


def write_report(report: Report) -> Path:
    """Writes plots, pictures and report.html; returns the path of the last."""
    budgets = _chosen_budgets(report)
    shown = _draw_pictures(report, budgets)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("fogbank.comparison", "."), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"figure": figure, "seconds": seconds, "count": count}
    text = environment.get_template(_TEMPLATE).render(
        report=report,
        unit="records" if report.by_records else "s",
        plots=_draw_plots(report),
        budgets=budgets,
        shown=shown,
        names=[_REFERENCE, *report.methods],
        rows=_rows(report),
        failures=_failures(report),
        costs=[
            {"heading": _HEADINGS[kind], "kind": kind, "rows": _cost_rows(report, report.costs[kind])}
            for kind in _kinds(report)
        ],
        verdicts=analysis.verdicts(report.means, report.costs[_kinds(report)[0]], report.methods, report.base),
        split=report.split.to_dict("records"),
        caches=_caches(report),
        residual=report.reference.residual,
    )
    path = report.folder / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def figure(value: float | None) -> str:
    """A number with two or three digits; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.3g}" if abs(value) >= 1 else f"{value:.2g}"


def seconds(value: float | None) -> str:
    """A time."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.3g} s"


def count(value: float | None) -> str:
    """A whole number, thousands apart."""
    return "-" if value is None or not math.isfinite(value) else f"{value:,.0f}".replace(",", " ")


def _chosen_budgets(report: Report) -> list[float]:
    budgets = sorted({budget for _, budget, _ in report.images})
    if len(budgets) <= _MOST_BUDGETS:
        return budgets
    return [budgets[index] for index in np.linspace(0, len(budgets) - 1, _MOST_BUDGETS).round().astype(int)]


def _kinds(report: Report) -> list[analysis.Cost]:
    """What costs are shown, the most important first."""
    return [*(["records"] if report.by_records else []), "cpu_seconds", "wall_seconds"]  # type: ignore[list-item]


def _draw_plots(report: Report) -> list[dict[str, str]]:
    folder = report.folder / "plots"
    folder.mkdir(exist_ok=True)
    reference = report.reference
    floor = resolution(reference.half_a, reference.half_b) if reference.independent else None
    drawn = []
    for kind in _kinds(report):
        path = folder / f"error_{kind}.png"
        error_plot(report.means, report.methods, kind, path, f"{report.scene}: error", floor=floor)
        drawn.append({"source": _data(path.read_bytes()), "name": kind.replace("_", " ").replace("cpu", "CPU")})
    return drawn


def _draw_pictures(report: Report, budgets: Sequence[float]) -> dict[str, Any]:
    """Pictures, maps and insets of each chosen budget, as data for the page: seed 1 of every method that has one."""
    folder = report.folder / "pictures"
    folder.mkdir(exist_ok=True)
    reference = report.reference.mean
    toning = Toning.of(reference)
    white = toning.colours(reference)
    sources = {"image": {_REFERENCE: _save(folder / "reference.png", white)}, "error": {}, "flip": {}}
    insets: dict[str, list[dict[str, Any]]] = {}
    for budget in budgets:
        images = {
            method: read(path)
            for method in report.methods
            if (path := report.images.get((method, budget, 1))) is not None
        }
        windows = report.insets
        if windows is None:
            windows = pictures.choose_insets(list(images.values()), reference) if images else []
        crops: list[dict[str, Any]] = [
            {"window": window, "parts": [(_REFERENCE, _data(_png(pictures.crop(white, window))))]} for window in windows
        ]
        for method, image in images.items():
            key = f"{method}@{budget:g}"
            name = report.images[method, budget, 1].stem
            colours = toning.colours(image)
            sources["image"][key] = _save(folder / f"{name}.png", colours)
            error_map, flip_map = pictures.error_map(image, reference), pictures.flip_map(image, reference)
            sources["error"][key] = _save(folder / f"{name}_error.png", error_map)
            sources["flip"][key] = _save(folder / f"{name}_flip.png", flip_map)
            for row in crops:
                row["parts"].append((method, _data(_png(pictures.crop(colours, row["window"])))))
        insets[f"{budget:g}"] = crops
    return {
        "sources": sources,
        "insets": insets,
        "width": reference.shape[1],
        "height": reference.shape[0],
        "exposure": toning.exposure,
    }


def _caches(report: Report) -> list[dict[str, str]]:
    """The records from above, of the largest budget of each method that has them."""
    found: dict[str, dict[str, str]] = {}
    for (method, budget, _), path in sorted(report.images.items(), key=lambda item: item[0][1]):
        drawing = path.with_suffix(".cache.png")
        if drawing.is_file():
            found[method] = {"method": method, "budget": f"{budget:g}", "source": _data(drawing.read_bytes())}
    return list(found.values())


def _rows(report: Report) -> list[dict[str, Any]]:
    return report.means.to_dict("records")  # type: ignore[return-value]


def _failures(report: Report) -> list[dict[str, Any]]:
    """Of runs that aren't done one row for each method, status and message."""
    failed = report.results[report.results["status"] != "done"]
    grouped = failed.groupby(["method", "status", "message"], sort=False)["budget"]
    return [
        {
            "method": method,
            "status": status,
            "message": message,
            "budgets": ", ".join(f"{budget:g}" for budget in sorted(set(budgets))),
        }
        for (method, status, message), budgets in grouped
    ]


def _cost_rows(report: Report, costs: pd.DataFrame) -> list[dict[str, Any]]:
    """A row for each level of error, with a cell for each method."""
    rows = []
    for level, group in costs.groupby("error", sort=False):
        cells = group.set_index("method")
        rows.append({"error": level, "cells": [cells.loc[method].to_dict() for method in report.methods]})
    return rows


def _save(path: Path, colours: Colours) -> str:
    data = _png(colours)
    path.write_bytes(data)
    return _data(data)


def _png(colours: Colours) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(colours).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _data(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()
