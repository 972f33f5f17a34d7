"""A sweep on a farm of local workers against the same sweep on one server, as a user types them.

    python -m tests.bench.farm_sweep [SCENE.xml] [--frames 60] [--size 32x20] [--error 0.1] [--spp 16] [--repeats 1]

`fogbank sweep` with one server of two threads, a frame at a time, and `fogbank farm sweep --local 2` with two workers
of one thread, each with an empty cache. Printed are wall-clock and CPU seconds of the whole command, servers and the
start of everything included, and the machine's load before. The pictures are compared, bit for bit.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from fogbank.comparison import image_error

ROOT = Path(__file__).resolve().parents[2]
FOGBANK = Path(sys.executable).parent / "fogbank"
WORKERS = 2

WAYS = {
    "one at a time": ("sweep", "--in-flight", "1"),
    "farm": ("farm", "sweep", "--local", str(WORKERS)),
}


def cpu_of_children() -> float:
    """CPU seconds of all processes that were waited for, and of those that they waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", type=Path, default=ROOT / "scenes" / "penumbra" / "penumbra.xml")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", default="32x20", help="of a frame, in pixels")
    parser.add_argument("--error", default="0.1")
    parser.add_argument("--spp", default="16")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--fill", default="first", choices=["first", "ahead", "none"])
    given = parser.parse_args()
    common = [str(given.scene), "--orbit", str(given.frames), "--size", given.size, "--error", given.error]
    common += ["--spp", given.spp, "--fill", given.fill, "--json"]
    spent: dict[str, list[tuple[float, float]]] = {way: [] for way in WAYS}
    for _ in range(given.repeats):
        with tempfile.TemporaryDirectory() as folder:
            made: dict[str, list[Path]] = {}
            for number, (way, command) in enumerate(WAYS.items()):
                here = Path(folder) / str(number)
                load, cpu, began = os.getloadavg()[0], cpu_of_children(), time.monotonic()
                done = subprocess.run(
                    [FOGBANK, "--data", here / "data", *command, *common, "-o", here / "%04d.exr"],
                    env={**os.environ, "XDG_CACHE_HOME": str(here / "cache"), "FOGBANK_THREADS": str(WORKERS)},
                    stdout=subprocess.PIPE,
                    text=True,
                    check=True,
                )
                wall, cpu = time.monotonic() - began, cpu_of_children() - cpu
                spent[way].append((wall, cpu))
                totals = json.loads(done.stdout.splitlines()[-1])
                made[way] = sorted(here.glob("*.exr"))
                print(
                    f"{way}: {wall:.1f} s wall, {cpu:.1f} s CPU, load {load:.1f} before;"
                    f" {totals['records_new']} records in {totals['fill_seconds']:.1f} s,"
                    f" frames {totals['render_cpu_seconds']:.1f} s CPU",
                    flush=True,
                )
            one, other = made.values()
            assert len(one) == len(other) == given.frames
            for first, second in zip(one, other, strict=True):
                np.testing.assert_array_equal(image_error.read(first), image_error.read(second))
    alone, farm = (np.array(spent[way]) for way in WAYS)
    for what, column in (("wall", 0), ("CPU", 1)):
        ratio = statistics.median(farm[:, column]) / statistics.median(alone[:, column])
        print(f"farm / one at a time, {what}: {ratio:.2f}")


if __name__ == "__main__":
    main()
