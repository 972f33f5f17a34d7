"""Error against run time: methods of Fogbank and other renderers side by side on one scene.

Needs the extra `compare` of the package. `compare` makes the pictures, measures them and writes a report; `image_error`
has the measures, `references` makes what they are measured against.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

from fogbank.comparison.extras import require_extra

if TYPE_CHECKING:
    from fogbank.comparison.comparison import Comparison
    from fogbank.comparison.runner import ComparisonProgress
    from fogbank.window import Window

BUDGETS = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0)
SEEDS = 3


def compare(
    scene: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    methods: Sequence[str] | None = None,
    budgets: Sequence[float] = BUDGETS,
    seeds: int = SEEDS,
    equal: Literal["time", "records"] = "time",
    spp: int | None = None,
    reference: str | os.PathLike[str] | None = None,
    make_reference: float | None = None,
    size: tuple[int | None, int | None] | None = None,
    max_depth: int | None = None,
    parameters: Mapping[str, object] | None = None,
    adapters: Mapping[str, str] | None = None,
    insets: Sequence[Window] | None = None,
    threads: int | None = None,
    memory_bytes: int | None = None,
    command: str | None = None,
    on_progress: Callable[[ComparisonProgress], None] | None = None,
) -> Comparison:
    """Renders a scene with several methods for the same times and measures the pictures.

    Every method gets the same XML: this size, the filter box, no crop window (`scene_text`). Each runs in a process of
    its own, caches begin empty for every picture, and methods take turns. What `output` already holds is not made
    again, so an interrupted comparison goes on where it was.

    Args:
        scene: the XML file.
        output: folder for report.html, results.csv, plots, pictures and EXRs.
        methods: see `methods.parse_methods`; every integrator of the server, mitsuba and mitsuba+oidn by default.
        budgets: wall-clock seconds of rendering, or numbers of records with `equal="records"`.
        seeds: pictures of each method and budget, >= 1.
        equal: what `budgets` are. Records: methods without a cache are left out, and `spp` is the same for all.
        spp: samples per pixel with `equal="records"`; the scene's by default.
        reference: EXR to measure against; NAME_a.exr and NAME_b.exr beside it are taken as independent halves.
        make_reference: seconds for a reference of our own in `output`, made before anything else; 20 times the largest
            budget by default, 60 at least.
        size: width and height in pixels, None for one that follows; the scene's by default, the reference's if given.
        max_depth: greatest path length in edges; the scene's by default.
        parameters: values for `$name` in the XML.
        adapters: further renderers: commands by name, see `command_worker`.
        insets: windows to enlarge; by default where methods differ most.
        threads: of every method; one per core by default.
        memory_bytes: most private memory of each method's process; four fifths of the machine's by default.
        command: what the report says reproduces it.
        on_progress: is told what is being done.

    Raises ModuleNotFoundError, naming the extra, when packages are missing, InvalidArgumentError for unknown methods
    and for an `output` that holds another comparison, InvalidSceneError and OSError for files that can't be read. A
    method that can't be run, fails or runs out of memory is a row that says so.
    """
    require_extra()
    from fogbank.comparison.comparison import Request, run_comparison

    return run_comparison(
        Request(
            scene=os.fspath(scene),
            output=os.fspath(output),
            methods=None if methods is None else tuple(methods),
            budgets=tuple(map(float, budgets)),
            seeds=seeds,
            equal=equal,
            spp=spp,
            reference=None if reference is None else os.fspath(reference),
            make_reference=make_reference,
            size=size,
            max_depth=max_depth,
            parameters={name: str(value) for name, value in (parameters or {}).items()},
            adapters=dict(adapters or {}),
            insets=None if insets is None else tuple(insets),
            threads=threads,
            memory_bytes=memory_bytes,
            command=command,
        ),
        on_progress,
    )
