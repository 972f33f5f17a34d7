"""Rendering on many machines: Dask distributed places the work, the picture stays the same, bit for bit.

import fogbank.farm
with fogbank.connect() as service, fogbank.farm.local_cluster(4) as client:
    job = fogbank.farm.render(service.load("scenes/shafts/shafts.xml"), client, spp=64)
    job.result().save("out.exr")

Needs the extra `farm`: pip install 'fogbank[farm]'.
"""

from fogbank.farm_extra import require_extra

require_extra()

from fogbank.farm.cluster import SchedulerTls, kubernetes_cluster, local_cluster, scheduler_client, slurm_cluster  # noqa: E402
from fogbank.farm.errors import FarmError  # noqa: E402
from fogbank.farm.farm import Farm, WorkerLimits, fill_events, render  # noqa: E402
from fogbank.farm.farm_job import FarmJob  # noqa: E402
from fogbank.farm.statistics import FarmStatistics  # noqa: E402
from fogbank.farm.status import FarmStatus, WorkerStatus, farm_status  # noqa: E402

__all__ = [
    "Farm",
    "FarmError",
    "FarmJob",
    "FarmStatistics",
    "FarmStatus",
    "SchedulerTls",
    "WorkerLimits",
    "WorkerStatus",
    "farm_status",
    "fill_events",
    "kubernetes_cluster",
    "local_cluster",
    "render",
    "scheduler_client",
    "slurm_cluster",
]
