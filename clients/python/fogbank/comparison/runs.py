"""The pictures of a comparison on the disk: one EXR and one JSON file each, so that what is there is not made again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from fogbank.comparison.engine import Failure
from fogbank.comparison.methods import Method
from fogbank.errors import InvalidArgumentError

Status = Literal["done", "not installed", "not tried", "not applicable"] | Failure


@dataclass(frozen=True)
class Run:
    """One picture: planned, made or failed."""

    method: str
    """Its name."""

    budget: float
    """Seconds, or records."""

    seed: int
    """Of the random numbers."""

    status: Status = "not tried"
    """What became of it."""

    message: str = ""
    """Why it isn't done, or what else is to be known."""

    figures: dict[str, Any] = field(default_factory=dict)
    """Of `worker.Rendered` and `worker.Started`."""

    errors: dict[str, float] = field(default_factory=dict)
    """Of `image_error.ImageError`, and "flip"."""

    reference: str = ""
    """SHA-256 of what `errors` were measured against."""


class RunStore:
    """Folder of a comparison."""

    def __init__(self, folder: Path) -> None:
        """Makes the folder."""
        self.folder = folder
        self._runs = folder / "runs"
        self._runs.mkdir(parents=True, exist_ok=True)

    def image_path(self, run: Run, method: Method) -> Path:
        """Where its EXR is or will be."""
        return self._runs / f"{_name(run, method)}.exr"

    def load(self, run: Run, method: Method) -> Run:
        """The run as it is on the disk; as given when it was not done."""
        path = self._runs / f"{_name(run, method)}.json"
        if not (path.is_file() and self.image_path(run, method).is_file()):
            return run
        return Run(**json.loads(path.read_text(encoding="utf-8")))

    def save(self, run: Run, method: Method) -> None:
        """Writes a run that is done; its image is there already."""
        write_json(self._runs / f"{_name(run, method)}.json", asdict(run))

    def check_settings(self, settings: dict[str, Any]) -> None:
        """Writes down what all runs have in common; InvalidArgumentError when the folder holds others."""
        path = self.folder / "comparison.json"
        if path.is_file():
            found = json.loads(path.read_text(encoding="utf-8"))
            different = sorted(name for name in settings if found.get(name) != settings[name])
            if different:
                raise InvalidArgumentError(
                    f"{self.folder} holds a comparison with another {', '.join(different)}; choose another folder or"
                    " remove it",
                    metadata={"field": "output"},
                )
        write_json(path, settings)


def plan(methods: Sequence[Method], budgets: Sequence[float], seeds: int, *, by_records: bool) -> list[Run]:
    """All runs. Methods take turns, so that whatever else the machine does meets all of them."""
    runs = []
    for seed in range(1, seeds + 1):
        for budget in budgets:
            for method in methods:
                run = Run(method.name, budget, seed)
                if method.unavailable:
                    run = replace(run, status="not installed", message=method.unavailable)
                elif by_records and not method.cached:
                    run = replace(run, status="not applicable", message="makes no records")
                runs.append(run)
    return runs


def write_json(path: Path, value: dict[str, Any]) -> None:
    """A file of that name is replaced at once or not at all."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
    unfinished.replace(path)


def _name(run: Run, method: Method) -> str:
    return f"{method.file_name}_{run.budget:g}_{run.seed}"
