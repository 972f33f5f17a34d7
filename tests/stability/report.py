"""Tables and plots of measured errors."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tests.stability.cases import Family
from tests.stability.measure import EPSILON, QUANTITIES, Row
from tests.stability.scenes import SceneFamily, is_as_allowed

COLORS = {"value": "tab:blue", "gradient": "tab:orange", "hessian": "tab:green"}
MARKERS = {"arctangent": "o", "edge": "^", "arctangent, edge": "s", "": "o"}


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    columns = ["family", "parameter", "precision", "error_value", "error_gradient", "error_hessian"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*columns, "digits_lost", "form", "finite", "wrong_sign"])
        for row in rows:
            start = [row.family, row.parameter, row.precision, *row.errors]
            form = ", ".join(row.forms)
            writer.writerow([*start, f"{row.digits_lost:.2f}", form, row.is_finite, row.is_wrong_sign])


def number(error: float) -> str:
    return "-" if math.isnan(error) else f"{error:.1e}"


def is_enough(family: Family, row: Row) -> bool:
    """Whether the engine may use this precision here."""
    low, high = family.float_is_enough
    return row.precision == "double" or low <= row.parameter <= high


def verdict(family: Family, row: Row) -> str:
    if not row.is_finite:
        return "NOT FINITE"
    if not is_enough(family, row):
        return "use double"
    return "WRONG SIGN" if row.is_wrong_sign else ""


def handover(rows: Sequence[Row]) -> str:
    """Which formulation answers, and from which parameter on another does."""
    parts: list[str] = []
    last = ""
    for row in rows:
        form = ", ".join(row.forms)
        if form and form != last:
            parts.append(f"{form} from {row.parameter:g}" if last else form)
            last = form
    return "; ".join(parts)


def write_markdown(path: Path, families: Sequence[Family], rows: Sequence[Row]) -> None:
    lines = [
        "# Stability of the closed forms",
        "",
        "Largest relative error over random shapes against high-precision arithmetic (value of edge-on triangles:",
        "absolute error). Digits lost count from the precision's epsilon. Where float is not enough, the table says",
        "so; that range is left out of its column below.",
        "",
        "| family | parameter | float: digits lost | double: digits lost | float is enough | formulation |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for family in families:
        own = [row for row in rows if row.family == family.name]
        cells = []
        for precision in EPSILON:
            lost = [row.digits_lost for row in own if row.precision == precision and is_enough(family, row)]
            cells.append(f"{max(lost):.1f}")
        low = family.float_is_enough[0]
        enough = "everywhere" if low == -math.inf else f"from {low:g} up"
        forms = handover([row for row in own if row.precision == "double"])
        lines.append(f"| {family.name} | {family.parameter} | {cells[0]} | {cells[1]} | {enough} | {forms} |")
    for family in families:
        lines += ["", f"## {family.name}", "", *([family.note, ""] if family.note else [])]
        lines.append(f"| {family.parameter} | precision | value | gradient | Hessian | digits lost | form | |")
        lines.append("| --- | --- | --- | --- | --- | --- | --- | --- |")
        for row in rows:
            if row.family == family.name:
                errors = " | ".join(number(error) for error in row.errors)
                lines.append(
                    f"| {row.parameter:g} | {row.precision} | {errors} | {row.digits_lost:.1f} "
                    f"| {', '.join(row.forms)} | {verdict(family, row)} |"
                )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_scene_markdown(path: Path, families: Sequence[SceneFamily], rows: Sequence[Row]) -> None:
    lines = [
        "# Stability of the occlusion-aware estimator",
        "",
        "Largest errors of whole estimates in stiff scenes: 1024 directions, hence 8 x 8 cells a light, all terms of",
        "the Hessian. What is allowed includes the resolution of that grid.",
    ]
    for family in families:
        allowed = ", ".join(f"{a:g}" for a in family.allowed)
        lines += ["", f"## {family.name}", "", f"{family.note[0].upper()}{family.note[1:]}. Allowed: {allowed}.", ""]
        lines.append(f"| {family.parameter} | value | gradient | Hessian | |")
        lines.append("| --- | --- | --- | --- | --- |")
        for row in rows:
            if row.family == family.name:
                errors = " | ".join(number(error) for error in row.errors)
                lines.append(f"| {row.parameter:g} | {errors} | {'' if is_as_allowed(family, row) else 'EXCEEDED'} |")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plot_scenes(path: Path, families: Sequence[SceneFamily], rows: Sequence[Row]) -> None:
    columns = 3
    lines = math.ceil(len(families) / columns)
    figure, grid = plt.subplots(lines, columns, figsize=(4 * columns, 2.8 * lines), squeeze=False)
    for axes, family in zip(grid.flat, families, strict=False):
        own = [row for row in rows if row.family == family.name]
        for i, quantity in enumerate(QUANTITIES):
            errors = [max(row.errors[i], EPSILON["double"] / 16) for row in own]
            axes.plot(family.parameters, errors, "o-", color=COLORS[quantity], linewidth=1, markersize=3)
            axes.axhline(family.allowed[i], color=COLORS[quantity], linewidth=0.8, linestyle=":")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(1e-18, 1e2)
        axes.set_title(family.name, fontsize=9)
        axes.set_xlabel(family.parameter, fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in list(grid.flat)[len(families) :]:
        axes.set_visible(False)
    handles = [Line2D([], [], color=color, label=quantity) for quantity, color in COLORS.items()]
    handles.append(Line2D([], [], color="k", linestyle=":", label="allowed"))
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), fontsize=9, frameon=False)
    figure.supylabel("error", fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.35 / figure.get_figheight()))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def plot_family(axes: Axes, family: Family, rows: Sequence[Row]) -> None:
    for precision, style in (("float", "-"), ("double", "--")):
        own = [row for row in rows if row.family == family.name and row.precision == precision]
        own = [row for row in own if row.parameter > 0]
        for i, quantity in enumerate(QUANTITIES):
            # Errors of 0 can't be drawn on a logarithmic axis.
            floor = EPSILON[precision] / 16
            points = [(r.parameter, max(r.errors[i], floor)) for r in own if not math.isnan(r.errors[i])]
            axes.plot(*zip(*points, strict=True), style, color=COLORS[quantity], linewidth=1)
            for row in own:
                if not math.isnan(row.errors[i]):
                    marker = MARKERS[", ".join(row.forms)]
                    height = max(row.errors[i], floor)
                    axes.plot(row.parameter, height, marker, color=COLORS[quantity], markersize=3)
        axes.axhline(EPSILON[precision], color="0.7", linewidth=0.8, zorder=0)
    low = family.float_is_enough[0]
    if low > -math.inf:
        axes.axvspan(min(family.parameters), low, color="tab:red", alpha=0.08, linewidth=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(1e-18, 1e2)
    axes.set_title(family.name, fontsize=9)
    axes.set_xlabel(family.parameter, fontsize=8)
    axes.tick_params(labelsize=7)


def plot(path: Path, families: Sequence[Family], rows: Sequence[Row]) -> None:
    drawn = [family for family in families if sum(parameter > 0 for parameter in family.parameters) > 5]
    drawn = [family for family in drawn if any(not math.isnan(r.errors[0]) for r in rows if r.family == family.name)]
    columns = 4
    lines = math.ceil(len(drawn) / columns)
    figure, grid = plt.subplots(lines, columns, figsize=(4 * columns, 2.8 * lines), squeeze=False)
    for axes, family in zip(grid.flat, drawn, strict=False):
        plot_family(axes, family, rows)
    for axes in list(grid.flat)[len(drawn) :]:
        axes.set_visible(False)
    handles: list[Artist] = [Line2D([], [], color=color, label=quantity) for quantity, color in COLORS.items()]
    handles += [Line2D([], [], color="k", label="float"), Line2D([], [], color="k", linestyle="--", label="double")]
    labels = {"arctangent": "arctangent form", "edge": "edge form", "arctangent, edge": "both, by shape"}
    handles += [Line2D([], [], color="k", linestyle="", marker=MARKERS[form], label=labels[form]) for form in labels]
    handles.append(Patch(color="tab:red", alpha=0.08, label="float is not enough"))
    figure.legend(handles=handles, loc="upper center", ncols=len(handles), fontsize=9, frameon=False)
    figure.supylabel("relative error", fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.35 / figure.get_figheight()))
    figure.savefig(path, dpi=110)
    plt.close(figure)
