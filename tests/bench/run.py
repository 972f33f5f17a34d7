"""Measures what the README promises, prints tables and writes out/bench/*.json.

    python -m tests.bench.run [comparison] [embree] [loading] [serving] [form_factors] [derivatives]
                              [records] [leaving_out] [cache] [pictures] [reuse] [watch]
                                                                                            all of them by default

`watch` is the regression watch: it adds to tests/bench/history.json and ends with status 1 when something got worse.

Figures depend on the machine and on what else it does; ratios, of runs that take turns, much less. See the modules for
what exactly is measured.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import time
from collections.abc import Callable
from typing import Any

from fogbank.comparison.machine import processor

from tests.bench import (
    cache,
    comparison,
    derivatives,
    embree_share,
    engines,
    form_factors,
    loading,
    pictures,
    records,
    reuse,
    serving,
    watch,
)


def save(name: str, results: Any) -> None:  # noqa: ANN401 - JSON
    """Writes out/bench/<name>.json."""
    engines.OUTPUT.mkdir(parents=True, exist_ok=True)
    record = {
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "processor": processor(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg(),
        "results": results,
    }
    (engines.OUTPUT / f"{name}.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Runs the parts that were asked for."""
    arguments = argparse.ArgumentParser(description="Fogbank's benchmarks")
    arguments.add_argument(
        "parts", nargs="*", metavar="PART", help="comparison, embree, loading, serving, form_factors, ..."
    )
    arguments.add_argument("--scene", action="append", help="only this scene (comparison, embree, records)")
    arguments.add_argument("--scale", type=float, default=1, help="of the images' sides")
    arguments.add_argument("--spp", type=int, default=16, help="samples per pixel of a round")
    arguments.add_argument(
        "--mitsuba-rr-depth", type=int, help="where its roulette begins; as the scenes say by default"
    )
    arguments.add_argument("--rounds", type=int, default=8, help="rounds of the comparison")
    arguments.add_argument("--points", type=int, default=100, help="points of the derivatives in each scene")
    arguments.add_argument("--threads", type=int, default=os.cpu_count(), help="threads of Fogbank's engine")
    options = arguments.parse_args()
    cases = [case for case in comparison.cases() if not options.scene or case.name in options.scene]
    cases = [case.scaled(options.scale) for case in cases]
    if options.mitsuba_rr_depth is not None:
        cases = [dataclasses.replace(case, mitsuba_rr_depth=options.mitsuba_rr_depth) for case in cases]

    def run_comparison() -> str:
        results = []
        for case in cases:
            results.append(comparison.compare(case, options.spp, options.rounds, options.threads))
            save("comparison", results)
        return comparison.table(results)

    def run_embree() -> str:
        results = [embree_share.measure(case, options.spp) for case in cases]
        save("embree", results)
        return embree_share.table(results)

    def run_loading() -> str:
        result = loading.measure(rounds=5)
        save("loading", result)
        return loading.table(result)

    def run_serving() -> str:
        result = serving.measure(cases[0], options.spp)
        save("serving", result)
        return serving.table(result)

    def run_form_factors() -> str:
        rates = form_factors.measure(repetitions=5)
        save("form_factors", rates)
        return form_factors.table(rates)

    def run_records() -> str:
        results = {
            name: records.measure(path, records.DIRECTIONS)
            for name, path in records.scenes().items()
            if not options.scene or name in options.scene
        }
        save("records", results)
        return records.table(results)

    def run_derivatives() -> str:
        lines = derivatives.compare(options.points, samples=1024)
        save("derivatives", lines)
        return "\n".join(lines)

    def run_leaving_out() -> str:
        results = derivatives.measure_leaving_out()
        save("leaving_out", results)
        return derivatives.leaving_out_table(results)

    def run_cache() -> str:
        runs = cache.measure()
        save("cache", runs)
        return cache.table(runs)

    def run_pictures() -> str:
        results = []
        for case in pictures.cases():
            if not options.scene or case.name in options.scene:
                results.append(pictures.measure(case.scaled(options.scale), options.threads))
                save("pictures", results)
        return pictures.table(results)

    def run_reuse() -> str:
        results = reuse.measure(options.threads)
        save("reuse", results)
        return reuse.table(results)

    worse: list[str] = []

    def run_watch() -> str:
        findings = watch.watch(options.threads, lambda doing: print(doing, flush=True))
        save("watch", watch.results(findings))
        worse.extend(found.name for found in findings if found.failed)
        return watch.table(findings)

    parts: dict[str, Callable[[], str]] = {
        "comparison": run_comparison,
        "embree": run_embree,
        "loading": run_loading,
        "serving": run_serving,
        "form_factors": run_form_factors,
        "records": run_records,
        "derivatives": run_derivatives,
        "leaving_out": run_leaving_out,
        "cache": run_cache,
        "pictures": run_pictures,
        "reuse": run_reuse,
        "watch": run_watch,
    }
    unknown = set(options.parts) - set(parts)
    if unknown:
        arguments.error(f"unknown part {', '.join(sorted(unknown))}; one of: {', '.join(parts)}")
    print(f"{processor()}, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    for name in options.parts or parts:
        print(f"\n== {name}\n{parts[name]()}", flush=True)
    if worse:
        raise SystemExit(f"worse than before: {', '.join(worse)}")


if __name__ == "__main__":
    main()
