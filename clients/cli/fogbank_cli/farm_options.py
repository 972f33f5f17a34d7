"""Options that say on which workers a farm renders."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import click
from fogbank.farm_extra import require_extra, require_package

from fogbank_cli.option_groups import grouped
from fogbank_cli.parameter_types import SizeInBytesType

if TYPE_CHECKING:
    from distributed import Client
    from fogbank.farm import WorkerLimits

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

_FILE = click.Path(path_type=Path, dir_okay=False, exists=True)

_SCHEDULER_OPTIONS = (
    click.option(
        "--scheduler",
        envvar="FOGBANK_SCHEDULER",
        metavar="ADDRESS",
        help="tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler.",
    ),
    click.option("--dask-ca", envvar="FOGBANK_DASK_CA", type=_FILE, help="PEM file of the authority, for tls://."),
    click.option("--dask-certificate", envvar="FOGBANK_DASK_CERTIFICATE", type=_FILE, help="PEM file, for tls://."),
    click.option("--dask-key", envvar="FOGBANK_DASK_KEY", type=_FILE, help="PEM file, for tls://."),
)

_CLUSTER_OPTIONS = (
    click.option("--local", type=click.IntRange(1), metavar="N", help="N workers on this machine."),
    *_SCHEDULER_OPTIONS,
    click.option("--slurm", type=_FILE, help="YAML with the arguments of dask_jobqueue.SLURMCluster."),
    click.option("--kubernetes", type=_FILE, help="YAML of a DaskCluster, or with the arguments of KubeCluster."),
    click.option("--workers", type=click.IntRange(1), default=2, show_default=True, help="Of Slurm or Kubernetes."),
    click.option(
        "--worker-threads", type=click.IntRange(1), help="Render threads of each; 1 with --local, else its own."
    ),
    click.option(
        "--worker-memory", type=SizeInBytesType(), help="Most memory of each, e.g. 8G; its own limit if not given."
    ),
)


@dataclass(frozen=True)
class ClusterChoice:
    """What the options name."""

    local: int | None
    scheduler: str | None
    slurm: Path | None
    kubernetes: Path | None
    workers: int
    worker_threads: int | None
    worker_memory: int | None
    dask_ca: Path | None
    dask_certificate: Path | None
    dask_key: Path | None

    @property
    def worker_limits(self) -> WorkerLimits:
        """What `fogbank.farm.render` takes of them."""
        return {"worker_threads": self.worker_threads, "worker_memory_bytes": self.worker_memory}

    def open(self) -> AbstractContextManager[Client]:
        """The cluster's client; UsageError for a contradiction, and where a package is missing."""
        named = [self.local, self.slurm, self.kubernetes]
        if sum(item is not None for item in named) + (self.scheduler is not None) != 1:
            raise click.UsageError("give one of --local, --scheduler, --slurm and --kubernetes")
        require_farm()
        from fogbank import farm

        try:
            if self.local is not None:
                return farm.local_cluster(self.local, threads=self.worker_threads or 1, memory_bytes=self.worker_memory)
            if self.slurm is not None:
                require_package("dask_jobqueue", "pip install dask-jobqueue")
                return farm.slurm_cluster(self.slurm, self.workers)
            if self.kubernetes is not None:
                require_package("dask_kubernetes", "pip install dask-kubernetes")
                return farm.kubernetes_cluster(self.kubernetes, self.workers)
        except ModuleNotFoundError as error:
            raise click.UsageError(str(error)) from None
        assert self.scheduler is not None
        return open_scheduler(self.scheduler, self.dask_ca, self.dask_certificate, self.dask_key)


def cluster_options(command: Callable[..., Result]) -> Callable[..., Result]:
    """Adds the options; the command gets them as `cluster`, a `ClusterChoice`."""

    return grouped(command, "cluster", ClusterChoice, _CLUSTER_OPTIONS)


def scheduler_options(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Adds `--scheduler` and the certificates for it."""
    for option in reversed(_SCHEDULER_OPTIONS):
        command = option(command)
    return command


def open_scheduler(
    address: str, ca: Path | None, certificate: Path | None, key: Path | None
) -> AbstractContextManager[Client]:
    """A client of a scheduler; UsageError for certificates that are not complete."""
    require_farm()
    from fogbank import farm

    given = [file for file in (ca, certificate, key) if file is not None]
    if given and len(given) < 3:
        raise click.UsageError("--dask-ca, --dask-certificate and --dask-key belong together")
    tls = None if not given else farm.SchedulerTls(*given)
    return farm.scheduler_client(address, tls)


def require_farm() -> None:
    """UsageError where the extra `farm` is not installed; before `fogbank.farm` is imported."""
    try:
        require_extra()
    except ModuleNotFoundError as error:
        raise click.UsageError(str(error)) from None
