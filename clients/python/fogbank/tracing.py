"""W3C Trace Context: which trace of the caller's own a call belongs to (https://www.w3.org/TR/trace-context/)."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from fogbank.errors import InvalidArgumentError

_TRACEPARENT = re.compile(r"00-(?!0{32})[0-9a-f]{32}-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}")
_current: ContextVar[str | None] = ContextVar("fogbank_traceparent", default=None)


@contextmanager
def trace(traceparent: str) -> Iterator[None]:
    """Jobs, fills and probes that are begun in this block belong to a trace, as "00-{trace id}-{span id}-01" names it.

    A server that was started with --trace writes their spans below it. Without a block the environment variable
    TRACEPARENT counts. Raises InvalidArgumentError for what is no traceparent.
    """
    if not _TRACEPARENT.fullmatch(traceparent):
        raise InvalidArgumentError(f'traceparent: "{traceparent}" is not 00-(32 digits)-(16 digits)-(2 digits)')
    token = _current.set(traceparent)
    try:
        yield
    finally:
        _current.reset(token)


def trace_metadata() -> tuple[tuple[str, str], ...]:
    """What a call sends: nothing outside of any trace, and nothing for an environment variable that makes no sense."""
    traceparent = _current.get() or os.environ.get("TRACEPARENT", "")
    return (("traceparent", traceparent),) if _TRACEPARENT.fullmatch(traceparent) else ()
