"""Drives a leased job: has its tasks performed on Dask's workers, and hands in their results.

What is computed doesn't depend on anything decided here: who performs a task, when, and how often. Dask places batches,
moves what they need from worker to worker, and repeats those of workers that are lost.
"""

from __future__ import annotations

import contextlib
import queue
import time
import uuid
from collections import Counter
from collections.abc import Sequence
from typing import TypeAlias

from fogbank._generated.v1 import farm_pb2, render_pb2
from fogbank.channel import Connection
from fogbank.farm.coordination import JobEnded, Leases, TaskNumber, hand_in
from fogbank.farm.costs import Costs
from fogbank.farm.crew import SCHEDULER_ERRORS, Crew
from fogbank.farm.errors import FarmError
from fogbank.farm.job_log import JobLog
from fogbank.farm.parcels import Batch, BatchResult, JobIdentity
from fogbank.farm.plugin import cancel_batches, close_replicas, perform
from fogbank.farm.scene_parcel import SceneParcel
from fogbank.farm.stage import RunningBatch, Stage, kind_of, number_of
from fogbank.farm.statistics import FarmStatistics, StageStatistics

# Batches that a worker's thread has at once: one that is performed, and one that is on its way meanwhile.
_BATCHES_PER_SLOT = 2

_MOST_LEASED_TASKS = 1000

# How often workers are counted and stragglers looked for.
_TICK_SECONDS = 0.5

# The last figures are not worth more.
_FIGURES_SECONDS = 1.0

# Workers that hand in so many poisoned results are set aside.
_MOST_POISONED = 3

# Batches of a task that took their workers with them; what kills that many workers is the task.
_MOST_DEATHS = 20

_ENDED = (render_pb2.JOB_STATE_SUCCEEDED, render_pb2.JOB_STATE_FAILED, render_pb2.JOB_STATE_CANCELLED)


_Event: TypeAlias = "farm_pb2.LeaseTasksResponse | JobEnded | RunningBatch"


class Coordinator:
    """One job's tasks on a crew of workers; `run` returns when the job has ended, however it ends."""

    def __init__(
        self,
        connection: Connection,
        job: render_pb2.Job,
        scene: SceneParcel,
        crew: Crew,
        *,
        costs: Costs,
        build_id: str,
    ) -> None:
        """Takes over a leased job.

        Args:
            connection: to the coordinating server.
            job: as CreateJob answered.
            scene: its files.
            crew: the workers.
            costs: of such tasks, as far as they are known; learns from this job.
            build_id: of the coordinating server.
        """
        self.statistics = FarmStatistics(scene_bytes=scene.bytes)
        self._connection = connection
        self._job = job
        self._scene = scene
        self._crew = crew
        self._build_id = build_id
        self._costs = costs
        self._events: queue.Queue[_Event] = queue.Queue()
        self._leasing = False
        self._awaiting = False
        self._log: JobLog | None = None
        self._stage = Stage()
        self._running: dict[str, RunningBatch] = {}
        self._wanted: dict[TaskNumber, farm_pb2.LeasedTask] = {}
        self._deaths: Counter[TaskNumber] = Counter()
        self._log_lengths: dict[str, int] = {}
        self._looked = 0.0

    def run(self) -> None:
        """Works until the job has ended. FarmError when the farm cannot go on; the job is as it was then."""
        leases = Leases(self._connection, self._job, self._events)
        try:
            while True:
                self._feed(leases)
                events = self._next_events()
                goes_on = self._handle(events)
                self.statistics.records = leases.records
                if not goes_on:
                    return
        finally:
            leases.close()
            self._drop(list(self._running.values()))
            if self._log is not None and self.statistics.batches > 0:
                self._crew.run(close_replicas, self._log.id)

    def _next_events(self) -> list[_Event]:
        events: list[_Event] = []
        try:
            events.append(self._events.get(timeout=_TICK_SECONDS))
            while True:
                events.append(self._events.get_nowait())
        except queue.Empty:
            return events

    def _note(self, events: Sequence[_Event]) -> None:
        """What the server did itself, which every answer says."""
        for event in events:
            if isinstance(event, farm_pb2.LeaseTasksResponse):
                self._awaiting = False
                self.statistics.own_tasks = event.own_tasks
                self.statistics.own_cpu_seconds = event.own_cpu_seconds

    def _await_figures(self) -> None:
        """The last answer comes with the job's end, perhaps a moment later."""
        with contextlib.suppress(queue.Empty):
            while self._awaiting:
                self._note([self._events.get(timeout=_FIGURES_SECONDS)])

    def _handle(self, events: Sequence[_Event]) -> bool:
        self._note(events)
        for event in events:
            if isinstance(event, JobEnded):
                if event.error is not None:
                    raise event.error
                self._await_figures()
                return False
            if isinstance(event, farm_pb2.LeaseTasksResponse):
                # There is nothing to ask for any more; with the end come the last figures.
                self._leasing = event.state in _ENDED
                if not self._leasing:
                    self._take(event)
        done = [event for event in events if isinstance(event, RunningBatch)]
        if done:
            self._complete(done)
        now = time.monotonic()
        if now - self._looked >= _TICK_SECONDS:
            self._looked = now
            self._look_around(now)
        return True

    def _take(self, response: farm_pb2.LeaseTasksResponse) -> None:
        if response.log and (self._log is None or self._log.id != response.log):
            self._begin_log(response.log)
        if response.stage != self._stage.number:
            self._begin_stage(response)
        if self._log is not None and response.log_length > self._log.length:
            before = self._log.bytes
            self._log.read(response.log_length)
            self.statistics.log_bytes += self._log.bytes - before
            self.statistics.stages[-1].log_bytes += self._log.bytes - before
        for task in response.tasks:
            if number_of(task) not in self._wanted:
                self._wanted[number_of(task)] = task
                self._stage.add(task)

    def _begin_log(self, log: str) -> None:
        """The job has begun, or begun again after its server did: nothing of before counts."""
        self._drop(list(self._running.values()))
        self._wanted.clear()
        self._log_lengths.clear()
        self._stage = Stage()
        self.statistics.stages.clear()
        self._log = JobLog(self._connection, self._job.name, log)

    def _begin_stage(self, response: farm_pb2.LeaseTasksResponse) -> None:
        self._drop([running for running in self._running.values() if running.stage < response.stage])
        self._wanted = {number: task for number, task in self._wanted.items() if number[0] >= response.stage}
        following = Stage(response.stage, response.stage_tasks, response.log_length)
        if self.statistics.stages:
            self.statistics.stages[-1].seconds = following.begun - self._stage.begun
        self._stage = following
        self.statistics.stages.append(StageStatistics(number=response.stage, tasks=response.stage_tasks))

    def _appetite(self) -> int:
        slots = max(self._crew.slots, 1)
        known = self._costs.seconds("tile")
        size = 1 if known is None else self._costs.batch_size("tile", slots=slots, left=_MOST_LEASED_TASKS)
        return min(_MOST_LEASED_TASKS, 2 * _BATCHES_PER_SLOT * slots * max(size, 4))

    def _feed(self, leases: Leases[RunningBatch]) -> None:
        """Submits batches while there is room, and asks for tasks when those at hand run low."""
        room = _BATCHES_PER_SLOT * max(self._crew.slots, 1)
        while self._stage.pending and len(self._running) < room and self._crew.good:
            tasks = self._stage.take_batch(self._costs, self._crew.slots)
            try:
                self._submit(tasks)
            except SCHEDULER_ERRORS:
                self._stage.give_back(tasks)
                self._reconnect()
        if not self._leasing and len(self._stage.pending) <= room // 2:
            self._leasing = self._awaiting = True
            leases.ask(self._appetite(), self._crew.trips.seconds())

    def _submit(
        self, tasks: Sequence[farm_pb2.LeasedTask], *, workers: Sequence[str] | None = None, second: bool = False
    ) -> None:
        assert self._log is not None
        kind = kind_of(tasks[0])
        number = f"{kind}-{uuid.uuid4().hex}"
        identity = JobIdentity(
            job=self._job.name,
            scene=self._job.scene,
            manifest=self._scene.manifest,
            settings=self._job.settings.SerializeToString(),
            log=self._log.id,
            build_id=self._build_id,
        )
        batch = Batch(number, identity, kind, tuple(task.SerializeToString() for task in tasks), self._stage.log_length)
        good = self._crew.good
        behind = min((self._log_lengths.get(worker, 0) for worker in good), default=0)
        client = self._crew.client
        log = self._log.segments(client, behind)
        files = self._scene.futures(client, good)
        future = client.submit(
            perform, batch, log, files, key=f"fogbank_{number}", pure=False, workers=workers or self._crew.allowed()
        )
        running = RunningBatch(batch, future, {number_of(task): task for task in tasks}, second)
        self._running[number] = running
        self.statistics.count_batch(kind, self._stage.number, sum(len(task.input) for task in tasks))
        future.add_done_callback(lambda _: self._events.put(running))

    def _complete(self, done: Sequence[RunningBatch]) -> None:
        mine = [running for running in done if self._running.pop(running.batch.number, None) is not None]
        finished = {running.batch.number: running.future for running in mine if running.future.status == "finished"}
        results = self._crew.gather(finished)
        self._hand_in([(running, results[running.batch.number]) for running in mine if running.batch.number in results])
        lost = [running for running in mine if running.batch.number not in results]
        if lost:
            self._recover(lost)

    def _hand_in(self, results: Sequence[tuple[RunningBatch, BatchResult]]) -> None:
        whose: dict[TaskNumber, str] = {}
        parts: list[farm_pb2.TaskResultPart] = []
        for running, result in results:
            own = [farm_pb2.TaskResultPart.FromString(data) for data in result.parts]
            self._learn(running, result, own)
            whose.update({(part.stage, part.index): result.worker for part in own})
            parts += own
        refused: dict[TaskNumber, str] = {}
        if parts and self._log is not None:
            ignored, refused = hand_in(self._connection, self._job.name, self._log.id, parts)
            self.statistics.ignored += ignored
        for part in parts:
            number = (part.stage, part.index)
            if part.last and number not in refused:
                self._wanted.pop(number, None)
        for number in refused:
            self.statistics.poisoned += 1
            worker = self.statistics.worker(whose[number])
            worker.poisoned += 1
            if worker.poisoned >= _MOST_POISONED:
                self._set_aside(whose[number], f"{worker.poisoned} poisoned results, the last one: {refused[number]}")
        for running, _ in results:
            self._put_back(running)
        # Of a batch that two workers had, the second one's is of no more use.
        self._drop([running for running in self._running.values() if self._wanted.keys().isdisjoint(running.tasks)])

    def _learn(self, running: RunningBatch, result: BatchResult, parts: Sequence[farm_pb2.TaskResultPart]) -> None:
        """Takes note of what the worker has, and of what its tasks cost."""
        worker = result.worker
        if result.parts:
            self._crew.trips.learn(time.monotonic() - running.submitted - result.seconds)
        if result.lacks == "scene":
            self._scene.holders.discard(worker)
        elif result.refusal is None:
            self._scene.holders.add(worker)
            self._log_lengths[worker] = result.log_length
        elif result.refusal.reason in ("BUILD_MISMATCH", "REPLICA_DIVERGED"):
            self._set_aside(worker, result.refusal.message)
        else:
            # Perhaps the worker's fault, perhaps the task's: as with poisoned results a few are borne.
            seen = self.statistics.worker(worker)
            seen.poisoned += 1
            if seen.poisoned >= _MOST_POISONED:
                self._set_aside(worker, f"{result.refusal.reason}: {result.refusal.message}")
        ends = [part for part in parts if part.last]
        seconds = sum(part.cpu_seconds for part in ends)
        self._costs.learn(running.batch.kind, seconds, len(ends))
        size = sum(len(data) for data in result.parts)
        self.statistics.count_results(running.batch.kind, running.stage, worker, len(ends), seconds, size)

    def _put_back(self, running: RunningBatch) -> None:
        """What the batch brought no good result of is done again, unless another batch is at it."""
        if running.stage != self._stage.number or (self._log and running.batch.identity.log != self._log.id):
            return
        elsewhere = {number for other in self._running.values() for number in other.tasks}
        lacking = self._wanted.keys() - elsewhere
        self._stage.put_back(task for number, task in running.tasks.items() if number in lacking)

    def _recover(self, lost: Sequence[RunningBatch]) -> None:
        """Batches that Dask gave up: their workers died again and again, or the scheduler is another one."""
        self.statistics.lost += len(lost)
        for running in lost:
            if running.future.status == "error":
                self._deaths.update(running.tasks.keys())
        worst = max(self._deaths.values(), default=0)
        if worst > _MOST_DEATHS:
            raise FarmError(
                f"a task of {self._job.name} ends the workers that perform it: {lost[0].future.exception()}",
                reason="TASK_KILLS_WORKERS",
            )
        if self._crew.client.status != "running" or any(running.future.cancelled() for running in lost):
            self._reconnect()
        for running in lost:
            self._put_back(running)

    def _reconnect(self) -> None:
        """The scheduler is another one, which knows nothing. Of what it lost Dask reports each batch."""
        self._crew.reconnect()
        self._scene.release()
        if self._log is not None:
            self._log.submit_again()

    def _set_aside(self, worker: str, why: str) -> None:
        self.statistics.worker(worker).set_aside = why
        self._crew.set_aside(worker, why)

    def _look_around(self, now: float) -> None:
        """Counts workers; when nothing is left to hand out, gives what takes too long to one that has nothing to do."""
        self._crew.count()
        self._crew.expect_good()
        late = [running for running in self._running.values() if running.late(now, self._costs)]
        if self._stage.pending or not late:
            return
        where = self._crew.processing()
        idle = [worker for worker in self._crew.good if worker not in where.values()]
        for running in late:
            tasks = [task for number, task in running.tasks.items() if number in self._wanted]
            if not idle or not tasks or where.get(str(running.future.key)) is None:
                continue
            running.second = True
            self.statistics.stragglers += 1
            with contextlib.suppress(*SCHEDULER_ERRORS):
                self._submit(tasks, workers=idle, second=True)

    def _drop(self, unwanted: Sequence[RunningBatch]) -> None:
        """Cancels batches, and stops those that are being performed."""
        if not unwanted:
            return
        for running in unwanted:
            self._running.pop(running.batch.number, None)
        self._crew.cancel([running.future for running in unwanted])
        self._crew.run(cancel_batches, [running.batch.number for running in unwanted])
