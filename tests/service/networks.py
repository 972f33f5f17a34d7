"""A second host on this machine: a network namespace behind a cable of its own."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Cable:
    """Between this host and the namespace. The names of its ends are those of the namespace, and a digit."""

    namespace: str
    here: str
    there: str

    def inside(self, *command: str) -> tuple[str, ...]:
        """A command, run on the other host."""
        return ("ip", "netns", "exec", self.namespace, *command)

    def limit(self, rate: str, latency: str = "50ms") -> None:
        """So many bits per second from now on, as tc writes them, either way."""
        self._queue("tbf", "rate", rate, "burst", "64kb", "latency", latency)

    def cut(self) -> None:
        """Nothing gets through any more, and nobody is told: queues that have room for no packet."""
        self._queue("bfifo", "limit", "1")

    def mend(self) -> None:
        """Undoes `cut` and `limit`."""
        self._queue("pfifo", "limit", "1000")

    def _queue(self, *discipline: str) -> None:
        _run("tc", "qdisc", "replace", "dev", f"{self.namespace}0", "root", *discipline)
        _run(*self.inside("tc", "qdisc", "replace", "dev", f"{self.namespace}1", "root", *discipline))


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


@contextlib.contextmanager
def other_host(namespace: str, subnet: str) -> Iterator[Cable]:
    """`namespace` has at most 14 characters; `subnet` are the first three numbers of its addresses.

    Skips the test, saying so, where this machine does not let us.
    """
    if os.geteuid() != 0 or shutil.which("ip") is None or shutil.which("tc") is None:
        pytest.skip("NOT TESTED: network namespaces need root, ip and tc")
    try:
        _run("ip", "netns", "add", namespace)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"NOT TESTED: no network namespaces here: {error.stderr.decode().strip()}")
    cable = Cable(namespace, f"{subnet}.1", f"{subnet}.2")
    try:
        try:
            _run(
                "ip",
                "link",
                "add",
                f"{namespace}0",
                "type",
                "veth",
                "peer",
                "name",
                f"{namespace}1",
                "netns",
                namespace,
            )
            _run("ip", "addr", "add", f"{cable.here}/30", "dev", f"{namespace}0")
            _run("ip", "link", "set", f"{namespace}0", "up")
            for command in (
                ("addr", "add", f"{cable.there}/30", "dev", f"{namespace}1"),
                ("link", "set", f"{namespace}1", "up"),
                ("link", "set", "lo", "up"),
            ):
                _run("ip", "-n", namespace, *command)
        except subprocess.CalledProcessError as error:
            pytest.skip(f"NOT TESTED: no cable between hosts here: {error.stderr.decode().strip()}")
        yield cable
    finally:
        _run("ip", "netns", "del", namespace)
