"""What tasks and trips cost, as measured, and how many tasks make a batch."""

from __future__ import annotations

import math
from collections import deque

from fogbank.farm.parcels import TaskKind

# A batch this long keeps what Dask spends on it (some 10 ms) below 2 %, and ends soon enough to balance a stage.
BATCH_SECONDS = 0.6

# CPU seconds that coordinator and scheduler spend on a batch, whatever is in it (tests/bench/farm_scaling.py measures
# them): they handle one after the other, however many workers there are.
HANDLING_SECONDS = 0.01

# Before anything is measured: on one idle machine.
_USUAL_TRIP_SECONDS = 0.03

# What the coordinating server may be kept from leasing a stage for, however slow the network is: it has few threads.
_MOST_TRIP_SECONDS = 0.25

# So many trips are remembered, and the quickest counts: the others may have waited for the batches before them.
_REMEMBERED_TRIPS = 16

# Weight of the newest measurement.
_LEARNING = 0.3


class Costs:
    """Seconds that a task of each kind takes on one thread."""

    def __init__(self) -> None:
        """Knows nothing yet."""
        self._mean: dict[TaskKind, float] = {}

    def learn(self, kind: TaskKind, seconds: float, tasks: int) -> None:
        """Takes note of `tasks` tasks that took so many seconds of one thread together."""
        if tasks <= 0 or not math.isfinite(seconds) or seconds < 0.0:
            return
        measured = seconds / tasks
        before = self._mean.get(kind)
        self._mean[kind] = measured if before is None else before + _LEARNING * (measured - before)

    def seconds(self, kind: TaskKind) -> float | None:
        """Of one task; None before the first one."""
        return self._mean.get(kind)

    def batch_size(self, kind: TaskKind, *, slots: int, left: int) -> int:
        """Tasks of the next batch, >= 1.

        Args:
            kind: of the tasks.
            slots: batches that can run at once.
            left: tasks of the stage that no batch has taken yet.
        """
        known = self._mean.get(kind)
        if known is None:
            return 1
        known = max(known, 1e-6)
        # Guided self-scheduling: batches shrink towards the end of a stage, so that no worker is left with the rest.
        by_rest = math.ceil(left / (2 * max(slots, 1)))
        # n batches of work of T seconds end after T / n + n h, h to handle one; the least is at n = sqrt(T / h).
        by_handling = math.sqrt(left * HANDLING_SECONDS / known)
        return max(1, int(by_handling), min(int(BATCH_SECONDS / known), by_rest))


class Trips:
    """How long a batch takes to a worker and back besides its performance. Any thread."""

    def __init__(self) -> None:
        """Knows nothing yet."""
        self._newest: deque[float] = deque(maxlen=_REMEMBERED_TRIPS)

    def learn(self, seconds: float) -> None:
        """Takes note of a trip, queues included."""
        if math.isfinite(seconds) and seconds >= 0.0:
            self._newest.append(seconds)

    def seconds(self) -> float:
        """Of the quickest of the newest trips; what the coordinator spends on it is the least."""
        quickest = min(tuple(self._newest), default=_USUAL_TRIP_SECONDS)
        return min(max(quickest, HANDLING_SECONDS), _MOST_TRIP_SECONDS)
