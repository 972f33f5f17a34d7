"""What a job's present stage consists of: tasks that wait, and batches that are performed."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from distributed import Future

from fogbank._generated.v1 import farm_pb2
from fogbank.farm.coordination import TaskNumber
from fogbank.farm.costs import Costs
from fogbank.farm.parcels import Batch, BatchResult, TaskKind

# Bytes of a batch's request; the wire takes 4 MiB.
_MOST_BATCH_BYTES = 3 << 20

# A batch that takes this many times as long as it should, and at least so long, is given to another worker as well.
_STRAGGLING_FACTOR = 4.0
_STRAGGLING_SECONDS = 2.0

_KINDS: dict[int, TaskKind] = {
    farm_pb2.TASK_KIND_PREPARATION: "preparation",
    farm_pb2.TASK_KIND_SURVEY: "survey",
    farm_pb2.TASK_KIND_TILE: "tile",
}


def kind_of(task: farm_pb2.LeasedTask) -> TaskKind:
    """What a task does."""
    return _KINDS.get(task.kind, "preparation")


def number_of(task: farm_pb2.LeasedTask) -> TaskNumber:
    """What a task is known by."""
    return task.stage, task.index


@dataclass
class RunningBatch:
    """A batch that was submitted."""

    batch: Batch
    future: Future[BatchResult]
    tasks: dict[TaskNumber, farm_pb2.LeasedTask]
    second: bool = False
    """Whether it was given to a second worker, or is what the second one was given."""

    submitted: float = field(default_factory=time.monotonic)

    @property
    def stage(self) -> int:
        """Of its tasks."""
        return min(self.tasks)[0]

    def late(self, now: float, costs: Costs) -> bool:
        """Whether a second worker should have it, by what such tasks are known to cost by now."""
        known = costs.seconds(self.batch.kind)
        if known is None or self.second:
            return False
        return now - self.submitted > max(_STRAGGLING_SECONDS, _STRAGGLING_FACTOR * known * len(self.tasks))


@dataclass
class Stage:
    """What is known of the job's present stage."""

    number: int = 0
    tasks: int = 0
    log_length: int = 0
    leased: int = 0
    begun: float = field(default_factory=time.monotonic)
    pending: deque[farm_pb2.LeasedTask] = field(default_factory=deque)

    def add(self, task: farm_pb2.LeasedTask) -> None:
        """Takes a task that was leased."""
        self.leased += 1
        self.pending.append(task)

    def take_batch(self, costs: Costs, slots: int) -> list[farm_pb2.LeasedTask]:
        """Tasks of the next batch, as many as pay; there must be some."""
        left = len(self.pending) + self.tasks - self.leased
        size = costs.batch_size(kind_of(self.pending[0]), slots=slots, left=left)
        tasks: list[farm_pb2.LeasedTask] = []
        weight = 0
        while self.pending and len(tasks) < size:
            weight += len(self.pending[0].input)
            if tasks and weight > _MOST_BATCH_BYTES:
                break
            tasks.append(self.pending.popleft())
        return tasks

    def give_back(self, tasks: Sequence[farm_pb2.LeasedTask]) -> None:
        """Tasks that could not be submitted, in their order."""
        self.pending.extendleft(reversed(tasks))

    def put_back(self, tasks: Iterable[farm_pb2.LeasedTask]) -> None:
        """Tasks that are to be performed again, unless they wait already."""
        waiting = {number_of(task) for task in self.pending}
        self.pending.extendleft(task for task in tasks if number_of(task) not in waiting)
