"""The Grafana dashboard asks for what a server really exports."""

from __future__ import annotations

import json
import re
import urllib.request
from typing import Any

import fogbank
import promql_parser
import pytest
from fogbank.credentials import Credentials
from prometheus_client.parser import text_string_to_metric_families

from tests.deploy.conftest import Deployed
from tests.deploy.examples import DEPLOY
from tests.service.harness import fog_scene

DASHBOARD = json.loads((DEPLOY / "monitoring" / "grafana" / "dashboards" / "fogbank.json").read_text())
ADDED_BY_PROMETHEUS = {"up": ("gauge", {"job", "instance"})}
OF_COUNTERS = {"rate", "increase", "irate"}


def queries() -> list[str]:
    """Every query, Grafana's variables replaced by something that they may stand for."""
    found = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
    return [query.replace("$__rate_interval", "1m").replace("$tenant", ".*") for query in found]


@pytest.fixture(scope="module")
def exported(deployed: Deployed, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, set[str]]]:
    """Type and labels of each metric, by name, after a job. Labels that no sample has are not there."""
    scene_file = tmp_path_factory.mktemp("scene") / "fog.xml"
    scene_file.write_bytes(fog_scene(width=16, height=16, samples=1))
    with fogbank.connect(deployed.server.target, credentials=Credentials(token=deployed.token)) as service:
        service.load(scene_file).render(spp=1).result()
    with urllib.request.urlopen(f"http://{deployed.metrics}/metrics", timeout=60) as answer:
        families = list(text_string_to_metric_families(answer.read().decode()))
    found = dict(ADDED_BY_PROMETHEUS)
    for family in families:
        # The parser takes the suffix off.
        name = family.name + "_total" if family.type == "counter" else family.name
        found[name] = (family.type, {label for sample in family.samples for label in sample.labels})
    return found


def selectors(expression: Any) -> list[tuple[Any, str | None]]:  # noqa: ANN401 - a node of any type
    """Vector selectors below a node, each with the function that is applied to its range."""
    kind = type(expression).__name__
    if kind == "VectorSelector":
        return [(expression, None)]
    if kind == "MatrixSelector":
        return [(expression.vector_selector, None)]
    if kind == "Call":
        return [(selector, expression.func.name) for argument in expression.args for selector, _ in selectors(argument)]
    if kind in ("AggregateExpr", "ParenExpr", "UnaryExpr", "SubqueryExpr"):
        return selectors(expression.expr)
    if kind == "BinaryExpr":
        return selectors(expression.lhs) + selectors(expression.rhs)
    assert kind in ("NumberLiteral", "StringLiteral"), kind
    return []


def grouping(expression: Any) -> set[str]:  # noqa: ANN401 - a node of any type
    """Labels that aggregations of an expression keep."""
    if type(expression).__name__ != "AggregateExpr":
        return set()
    modifier = expression.modifier
    return grouping(expression.expr) | (set() if modifier is None else set(modifier.labels))


@pytest.mark.parametrize("query", queries())
def test_query_finds_what_the_server_exports(query: str, exported: dict[str, tuple[str, set[str]]]) -> None:
    expression = promql_parser.parse(query)
    found = selectors(expression)
    assert found or query.startswith("time()")
    for selector, function in found:
        assert selector.name in exported, f"{selector.name} is not exported"
        kind, labels = exported[selector.name]
        # The rate of a gauge means nothing. Failures are shown as they stand: a reason's first one has no rate.
        as_it_stands = kind != "counter" or selector.name == "fogbank_job_failures_total"
        assert (function in OF_COUNTERS) != as_it_stands, f"{selector.name} is a {kind}"
        used = {matcher.name for matcher in selector.matchers.matchers} | grouping(expression)
        # Nothing has failed here and there are no quotas, so there is nothing to have these labels.
        assert not labels or used <= labels, f"{selector.name} has {labels}"


def test_legends_name_labels_that_are_kept() -> None:
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            query = target["expr"].replace("$__rate_interval", "1m")
            named = set(re.findall(r"{{(\w+)}}", target["legendFormat"]))
            assert named == grouping(promql_parser.parse(query)), panel["title"]


def test_every_metric_of_ours_is_shown(exported: dict[str, tuple[str, set[str]]]) -> None:
    shown = {selector.name for query in queries() for selector, _ in selectors(promql_parser.parse(query))}
    # The rate that the server makes itself is for `fogbank server status`; here Prometheus makes it from the counter.
    ours = {name for name in exported if name.startswith("fogbank_")} - {"fogbank_rays_per_second"}
    assert ours <= shown


def test_panels_do_not_overlap() -> None:
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert place["x"] + place["w"] <= 24
        assert not cells & taken, panel["title"]
        taken |= cells
