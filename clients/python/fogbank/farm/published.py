"""What `fogbank farm status` shows of the jobs of others: figures that the scheduler keeps."""

from __future__ import annotations

import logging
import threading
import time
from typing import Any

from distributed import Client

from fogbank.farm.crew import Crew
from fogbank.farm.statistics import FarmStatistics

_KEY = "fogbank-farm"
_PUBLISH_SECONDS = 2.0

# Jobs that ended are shown for so long.
_KEEP_SECONDS = 3600.0

_log = logging.getLogger(__name__)


class Publisher:
    """Tells the scheduler every two seconds how a job is doing."""

    def __init__(self, crew: Crew, job: str, statistics: FarmStatistics) -> None:
        """Begins with `start`."""
        self._crew = crew
        self._job = job
        self._statistics = statistics
        self._begun = time.time()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fogbank-farm-status", daemon=True)

    def start(self) -> None:
        """Begins to publish."""
        self._thread.start()

    def stop(self) -> None:
        """Publishes the last figures, and ends."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(_PUBLISH_SECONDS):
            self._publish(ended=False)
        self._publish(ended=True)

    def _publish(self, *, ended: bool) -> None:
        if self._crew.client.status != "running":
            return
        figures = self._statistics.as_dict()
        # The scheduler keeps all that it is told: of a long sweep thousands of jobs.
        del figures["stages"]
        value = {"begun": self._begun, "seen": time.time(), "ended": ended, "farm": figures}
        try:
            self._crew.client.set_metadata([_KEY, self._job], value)
        except (OSError, RuntimeError) as error:
            # Figures are not worth a job.
            _log.debug("cannot publish: %s", error)


def published_jobs(client: Client) -> dict[str, dict[str, Any]]:
    """What jobs have told of themselves within the last hour, by name."""
    jobs: dict[str, dict[str, Any]] = client.get_metadata([_KEY], {})
    now = time.time()
    return {name: job for name, job in jobs.items() if now - float(job["seen"]) < _KEEP_SECONDS}
