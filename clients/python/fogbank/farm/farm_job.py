"""Jobs that a farm performs."""

from __future__ import annotations

import threading
from collections.abc import Callable

from fogbank._generated.v1 import render_pb2
from fogbank.channel import Connection
from fogbank.errors import FogbankError
from fogbank.farm.coordinator import Coordinator
from fogbank.farm.crew import Crew
from fogbank.farm.published import Publisher
from fogbank.farm.statistics import FarmStatistics
from fogbank.job import Job


class FarmJob(Job):
    """A job whose tasks a cluster performs: to all who look at it a job like any other.

    It needs this program as the go-between: while nobody leases its tasks it waits.
    """

    def __init__(
        self,
        connection: Connection,
        message: render_pb2.Job,
        coordinator: Coordinator,
        crew: Crew,
        on_end: Callable[[], None],
    ) -> None:
        """Made by `Farm.render`, not by users. Begins at once, in a thread of its own.

        Args:
            connection: to the coordinating server.
            message: the job, which is leased.
            coordinator: drives it.
            crew: its workers.
            on_end: called by that thread when the farm has let go of the job.
        """
        super().__init__(connection, message)
        self._coordinator = coordinator
        self._crew = crew
        self._on_end = on_end
        self._failure: FogbankError | None = None
        self._thread = threading.Thread(target=self._run, name=f"fogbank-farm {self.name}", daemon=True)
        self._thread.start()

    @property
    def farm(self) -> FarmStatistics:
        """What the farm did for it so far."""
        return self._coordinator.statistics

    @property
    def error(self) -> FogbankError | None:
        """Why it failed or was cancelled: FarmError where that was the farm's doing; None for any other state."""
        if self._failure is not None and self.ended:
            return self._failure
        return super().error

    def join_farm(self, timeout: float | None = None) -> None:
        """Waits until the farm has let go of the job, at most `timeout` seconds: a moment after its end."""
        self._thread.join(timeout)

    def _run(self) -> None:
        publisher = Publisher(self._crew, self.name, self._coordinator.statistics)
        try:
            publisher.start()
            self._coordinator.run()
        except FogbankError as error:
            self._failure = error
        except Exception as error:
            self._failure = FogbankError(f"the farm of {self.name} failed: {type(error).__name__}: {error}")
        finally:
            if self._failure is not None:
                self._cancel_quietly()
            publisher.stop()
            self._on_end()

    def _cancel_quietly(self) -> None:
        try:
            self._connection.call(
                lambda stubs: stubs.render.CancelJob, render_pb2.CancelJobRequest(name=self.name), timeout=10.0
            )
        except FogbankError:
            # The server is gone as well, which is what the job's watchers hear.
            return
