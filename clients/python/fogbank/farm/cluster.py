"""Clusters to render on: workers of this machine, a scheduler somewhere, or what Slurm and Kubernetes give."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster, Security

from fogbank.errors import InvalidArgumentError
from fogbank.paths import cache_folder

# Of a scheduler that is just being started.
_CONNECT_SECONDS = 30.0

# A worker's engine is a process of its own: Dask's own must not be ended for what it thinks is a leak. What Dask
# samples about itself shows nothing of the engine, and takes 3 % of a core in every process, idle or not.
_WORKER_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "5s",
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
}


@dataclass(frozen=True)
class SchedulerTls:
    """Certificates for a scheduler that asks for them (`tls://`)."""

    ca: Path
    """PEM file of the authority that signed the certificates of all nodes."""

    certificate: Path
    """PEM file of this node's certificate."""

    key: Path
    """PEM file of its key."""

    def security(self) -> Security:
        """As Dask takes it."""
        return Security(
            require_encryption=True,
            tls_ca_file=str(self.ca),
            tls_client_cert=str(self.certificate),
            tls_client_key=str(self.key),
            tls_scheduler_cert=str(self.certificate),
            tls_scheduler_key=str(self.key),
            tls_worker_cert=str(self.certificate),
            tls_worker_key=str(self.key),
        )


@contextmanager
def local_cluster(workers: int, *, threads: int = 1, memory_bytes: int | None = None) -> Iterator[Client]:
    """Workers on this machine, which end with the context.

    Each has a server of its own, which is what renders; what hands it its tasks are threads of this process. They
    listen on no port: whoever reached one could run what they like as this user.

    Args:
        workers: processes.
        threads: of each.
        memory_bytes: most memory of each one's engine; an equal part of the machine's when None.
    """
    with (
        dask.config.set({**_WORKER_SETTINGS, "distributed.dashboard.link": "http://127.0.0.1:{port}/status"}),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=threads,
            memory_limit=memory_bytes or "auto",
            processes=False,
            dashboard_address="127.0.0.1:0",
            local_directory=str(cache_folder() / "farm"),
            silence_logs=40,
        ) as cluster,
        # Results come straight from the workers; elsewhere only the scheduler may be within reach.
        Client(cluster, set_as_default=False, direct_to_workers=True) as client,
    ):
        client.wait_for_workers(workers)
        yield client


@contextmanager
def scheduler_client(address: str, tls: SchedulerTls | None = None) -> Iterator[Client]:
    """A client of a scheduler that runs somewhere.

    Args:
        address: "tcp://host:8786", or "tls://host:8786" with certificates.
        tls: the certificates.

    Raises OSError when it cannot be reached, InvalidArgumentError when address and certificates don't go together.
    """
    if address.startswith("tls://") != (tls is not None):
        raise InvalidArgumentError(
            f"{address}: certificates belong to an address that begins with tls://, and it to them"
        )
    security = None if tls is None else tls.security()
    with Client(address, security=security, timeout=f"{_CONNECT_SECONDS:g}s", set_as_default=False) as client:
        yield client


@contextmanager
def slurm_cluster(file: Path, workers: int) -> Iterator[Client]:
    """Workers that Slurm starts as jobs, one worker with all cores of a job.

    They talk by TLS with certificates made for the occasion, which lie for that time in the current folder, or in
    `shared_temp_directory`: all nodes must see it.

    Args:
        file: YAML with the arguments of `dask_jobqueue.SLURMCluster`: cores, memory, queue, walltime...
        workers: jobs to ask for.

    Raises ModuleNotFoundError without dask-jobqueue, InvalidArgumentError for a file that is no mapping.
    """
    from dask_jobqueue.slurm import SLURMCluster

    arguments = _arguments(file)
    # Without it whoever reaches the port runs what they like, as this user.
    arguments.setdefault("security", True)
    arguments.setdefault("shared_temp_directory", str(Path.cwd()))
    # One server for each job, so that the scene is there once.
    arguments.setdefault("processes", 1)
    arguments["job_script_prologue"] = [*_worker_environment(), *arguments.get("job_script_prologue", [])]
    with SLURMCluster(**arguments) as cluster:
        cluster.scale(jobs=workers)
        with Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(1)
            yield client


@contextmanager
def kubernetes_cluster(file: Path, workers: int) -> Iterator[Client]:
    """Workers that Kubernetes starts as pods, through Dask's operator.

    Args:
        file: YAML of a DaskCluster resource, or with the arguments of `dask_kubernetes.operator.KubeCluster`.
        workers: pods to ask for.

    Raises ModuleNotFoundError without dask-kubernetes, InvalidArgumentError for a file that is no mapping.
    """
    from dask_kubernetes.operator import KubeCluster

    arguments = _arguments(file)
    if arguments.get("kind") == "DaskCluster":
        arguments = {"custom_cluster_spec": arguments}
    with KubeCluster(**arguments) as cluster:
        cluster.scale(workers)
        with Client(cluster, set_as_default=False) as client:
            client.wait_for_workers(1)
            yield client


def _worker_environment() -> list[str]:
    """The settings of workers as lines of a shell, by which Dask takes them."""
    return [
        f"export DASK_{name.upper().replace('.', '__').replace('-', '_')}={value}"
        for name, value in _WORKER_SETTINGS.items()
    ]


def _arguments(file: Path) -> dict[str, Any]:
    import yaml

    try:
        arguments = yaml.safe_load(file.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise InvalidArgumentError(f"{file}: {error}") from None
    if not isinstance(arguments, dict):
        raise InvalidArgumentError(f"{file}: a mapping of arguments was expected")
    return arguments
