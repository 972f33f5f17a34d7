"""When and how long to wait before a call is tried again."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from fogbank.errors import FogbankError, UnavailableError

_TRANSIENT_REASONS = frozenset({"UPLOAD_IN_PROGRESS", "UPLOAD_OFFSET_MISMATCH", "WATCH_STALLED", "PROBE_STALLED"})


def is_transient(error: FogbankError) -> bool:
    """True when trying again a little later, from where the server stands then, may succeed."""
    return isinstance(error, UnavailableError) or error.reason in _TRANSIENT_REASONS


@dataclass(frozen=True)
class RetryPolicy:
    """Exponential backoff with jitter; the defaults give up after about 10 s without any progress."""

    attempts: int = 7
    """Tries without progress before the error is raised, >= 1."""

    first_delay_seconds: float = 0.1
    """Longest wait before the second try; doubles with each further one."""

    longest_delay_seconds: float = 5.0
    """Upper bound of a wait."""

    sleep: Callable[[float], None] = field(default=time.sleep, compare=False)
    """How to wait, in seconds."""


class Backoff:
    """The state of one operation that is being retried."""

    def __init__(self, policy: RetryPolicy) -> None:
        """Starts with no failure seen."""
        self._policy = policy
        self._failures = 0

    def progressed(self) -> None:
        """Forgets earlier failures: something was achieved since."""
        self._failures = 0

    def wait_or_raise(self, error: FogbankError) -> None:
        """Waits before the next try, or raises `error` when it is not transient or the tries are used up."""
        self._failures += 1
        if not is_transient(error) or self._failures >= self._policy.attempts:
            raise error
        delay = min(
            self._policy.longest_delay_seconds,
            self._policy.first_delay_seconds * 2.0 ** (self._failures - 1),
        )
        # Half of the wait is random, so that clients which lost the same server do not return in step.
        self._policy.sleep(delay * random.uniform(0.5, 1.0))
