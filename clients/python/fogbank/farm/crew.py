"""The workers of a cluster, and the connection to it."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from distributed import Client, Future
from distributed.client import ClosedClientError
from distributed.deploy.cluster import Cluster

from fogbank.farm.costs import Trips
from fogbank.farm.errors import FarmError
from fogbank.farm.parcels import BatchResult
from fogbank.farm.plugin import FarmPlugin

_log = logging.getLogger(__name__)

# What calls meet while the scheduler is not there.
SCHEDULER_ERRORS = (OSError, ClosedClientError)

# A scheduler that is started again, by hand or by whatever looks after it, is waited for so long.
PATIENCE_SECONDS = 300.0
_RETRY_SECONDS = 1.0


class Crew:
    """Who may be given batches, by one job or several at once.

    Attributes:
        client: to the scheduler; another one after the scheduler was lost for long.
        trips: to the workers and back.
    """

    def __init__(self, cluster: Client | Cluster, plugin: FarmPlugin) -> None:
        """Registers the plugin with all workers, present and future ones. A cluster gets a client."""
        self._own_client = not isinstance(cluster, Client)
        self.client = cluster if isinstance(cluster, Client) else Client(cluster, set_as_default=False)
        self._plugin = plugin
        self._address = self.client.scheduler_info()["address"]
        self._security = self.client.security
        self.trips = Trips()
        self._reconnecting = threading.Lock()
        self._threads: dict[str, int] = {}
        self._aside: dict[str, str] = {}
        self.client.register_plugin(plugin)
        self.count()

    def count(self) -> None:
        """Asks the scheduler which workers there are; what was known stays while it cannot be reached."""
        with contextlib.suppress(*SCHEDULER_ERRORS):
            self._threads = {str(address): int(threads) for address, threads in self.client.nthreads().items()}

    @property
    def good(self) -> list[str]:
        """Addresses of those that may be given batches."""
        return [address for address in self._threads if address not in self._aside]

    @property
    def slots(self) -> int:
        """Batches that they can perform at once."""
        return sum(self._threads[address] for address in self.good)

    def set_aside(self, worker: str, why: str) -> None:
        """Gives a worker no more batches. FarmError when that leaves none."""
        if worker not in self._aside:
            _log.warning("worker %s is set aside: %s", worker, why)
            self._aside[worker] = why
        self.expect_good()

    def expect_good(self) -> None:
        """FarmError when there are workers and all of them are set aside."""
        if self._threads and not self.good:
            worker, why = list(self._aside.items())[-1]
            raise FarmError(f"no worker is left; the last one, {worker}, was set aside: {why}", reason="NO_WORKERS")

    def allowed(self) -> list[str] | None:
        """For `Client.submit`: None for all, else addresses."""
        return self.good if self._aside else None

    def gather(self, futures: Mapping[str, Future[BatchResult]]) -> dict[str, BatchResult]:
        """Results of finished batches, by the same keys; those that were lost with their worker are missing."""
        # Those of a client before are lost with it.
        known = {key: future for key, future in futures.items() if future.client is self.client}
        if not known:
            return {}
        try:
            return dict(self.client.gather(known, errors="skip"))
        except SCHEDULER_ERRORS:
            return {}

    def cancel(self, futures: Sequence[Future[BatchResult]]) -> None:
        """Takes batches back that have not begun."""
        with contextlib.suppress(*SCHEDULER_ERRORS):
            self.client.cancel(list(futures), force=True)

    def processing(self) -> dict[str, str]:
        """Which worker has which batch, by the keys of their futures."""
        try:
            return {str(key): str(worker) for worker, keys in self.client.processing().items() for key in keys}
        except SCHEDULER_ERRORS:
            return {}

    def run(self, function: Callable[..., object], *arguments: Any) -> None:  # noqa: ANN401 - the function's own
        """Runs a function on all workers at once, whatever they do; does not wait, and is not told of failures."""
        with contextlib.suppress(*SCHEDULER_ERRORS):
            self.client.run(function, *arguments, wait=False, on_error="ignore")

    def reconnect(self) -> None:
        """Waits for the scheduler to be there, again or anew. FarmError after PATIENCE_SECONDS."""
        with self._reconnecting:
            self._reconnect()

    def _reconnect(self) -> None:
        end = time.monotonic() + PATIENCE_SECONDS
        while True:
            try:
                if self.client.status == "closed":
                    self.client = Client(self._address, security=self._security, set_as_default=False, timeout="10s")
                    self._own_client = True
                self.client.register_plugin(self._plugin)
                self._threads = {}
                self.count()
                return
            except SCHEDULER_ERRORS as error:
                if time.monotonic() > end:
                    raise FarmError(
                        f"the scheduler at {self._address} is gone: {error}", reason="SCHEDULER_LOST"
                    ) from None
                time.sleep(_RETRY_SECONDS)

    def close(self) -> None:
        """Closes the client if it is not the user's."""
        if self._own_client:
            self.client.close()
