"""What a farm did for a job."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from fogbank.farm.parcels import TaskKind


@dataclass
class TaskStatistics:
    """Some of a job's tasks."""

    tasks: int = 0
    """How many."""

    cpu_seconds: float = 0.0
    """On the workers."""

    input_bytes: int = 0
    """Sent to workers with the tasks."""

    result_bytes: int = 0
    """Sent back."""


@dataclass
class WorkerStatistics:
    """What one worker did."""

    tasks: int = 0
    """Results of it that were handed in."""

    cpu_seconds: float = 0.0
    """Of these."""

    poisoned: int = 0
    """Results that were refused."""

    set_aside: str = ""
    """Why it gets no more batches; empty while it does."""


@dataclass
class StageStatistics(TaskStatistics):
    """Tasks that are independent of each other: a round of a preparation, or a pass."""

    number: int = 0
    """As the job counts them."""

    kind: TaskKind | None = None
    """Of its tasks; None before the first one is known."""

    log_bytes: int = 0
    """Of log entries that replicas need for this stage and did not for the one before."""

    seconds: float = 0.0
    """Wall-clock time from its first task to the next stage; 0 while it lasts."""


@dataclass
class FarmStatistics:
    """What a farm did for a job, so far."""

    kinds: dict[TaskKind, TaskStatistics] = field(default_factory=dict)
    """Tasks by kind; of these `tasks` counts results, repeated ones included."""

    workers: dict[str, WorkerStatistics] = field(default_factory=dict)
    """By address, lost ones included."""

    batches: int = 0
    """Submitted."""

    stragglers: int = 0
    """Batches that were given to a second worker because the first one took long."""

    lost: int = 0
    """Batches that were submitted again because their worker or the scheduler was lost."""

    own_tasks: int = 0
    """That the coordinating server performed itself, since a trip to a worker would have taken longer."""

    own_cpu_seconds: float = 0.0
    """Of these."""

    ignored: int = 0
    """Results that came late or twice."""

    poisoned: int = 0
    """Results that were refused."""

    records: int = 0
    """In the job's log, by which every worker gets them: those that were there, and those that the job has made."""

    log_bytes: int = 0
    """Of the log: what every worker needs to follow the job, most of all records."""

    scene_bytes: int = 0
    """Of the scene's files, which every worker gets once."""

    stages: list[StageStatistics] = field(default_factory=list)
    """In their order; of the job's present life."""

    def kind(self, kind: TaskKind) -> TaskStatistics:
        """Of one kind."""
        return self.kinds.setdefault(kind, TaskStatistics())

    def worker(self, address: str) -> WorkerStatistics:
        """Of one worker."""
        return self.workers.setdefault(address, WorkerStatistics())

    def count_batch(self, kind: TaskKind, stage: int, input_bytes: int) -> None:
        """Counts a batch that is submitted."""
        self.batches += 1
        for figures in self._figures(kind, stage):
            figures.input_bytes += input_bytes

    def count_results(
        self, kind: TaskKind, stage: int, worker: str, tasks: int, cpu_seconds: float, result_bytes: int
    ) -> None:
        """Counts the results of a batch."""
        self.kind(kind).tasks += tasks
        for figures in self._figures(kind, stage):
            figures.cpu_seconds += cpu_seconds
            figures.result_bytes += result_bytes
        mine = self.worker(worker)
        mine.tasks += tasks
        mine.cpu_seconds += cpu_seconds

    def _figures(self, kind: TaskKind, stage: int) -> list[TaskStatistics]:
        stages = [one for one in self.stages if one.number == stage]
        for one in stages:
            one.kind = kind
        return [self.kind(kind), *stages]

    def as_dict(self) -> dict[str, Any]:
        """As JSON takes it."""
        return asdict(self)
