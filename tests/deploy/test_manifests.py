"""compose.yaml and the Kubernetes manifests against their schemas, and what the schemas can't know."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from tests.deploy.examples import DEPLOY, compose, manifest, manifests, run, tool

VERSIONS = ("1.32", "1.37")
"""Of Kubernetes: the oldest and the newest that the manifests are for."""


def test_compose_file_is_valid() -> None:
    checked = run(tool("check-jsonschema"), "--builtin-schema", "vendor.compose-spec", str(DEPLOY / "compose.yaml"))
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_compose_services() -> None:
    found = compose()
    services: dict[str, dict[str, Any]] = found["services"]
    profiles = {name: service["profiles"] for name, service in services.items()}
    assert {profile for of_service in profiles.values() for profile in of_service} >= {"server", "farm", "monitoring"}
    for name, service in services.items():
        assert service["read_only"], name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        for other in service.get("depends_on", []):
            assert other in services
        for mount in service.get("volumes", []):
            source = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", mount).split(":")[0]
            if source.startswith("./"):
                assert (DEPLOY / source).exists(), f"{name}: {source}"
            elif not source.startswith(("..", "/")):
                assert source in found["volumes"], f"{name}: {source}"
    # What is published goes to loopback, or is behind TLS.
    published = [port for service in services.values() for port in service.get("ports", [])]
    open_ports = {port.rpartition(":")[2] for port in published if not port.startswith("127.0.0.1:")}
    assert open_ports == {"7070", "8786"}


@pytest.mark.parametrize("version", VERSIONS)
def test_kubernetes_manifests_are_valid(version: str) -> None:
    found = manifests()
    assert {"StatefulSet", "Deployment", "PodDisruptionBudget", "NetworkPolicy"} <= {each["kind"] for each in found}
    for each in found:
        kubernetes_validate.validate(each, version, strict=True)


def test_kustomization_builds() -> None:
    built = run(tool("kubectl"), "kustomize", str(DEPLOY))
    assert built.returncode == 0, built.stderr
    found = list(yaml.safe_load_all(built.stdout))
    # The generated ConfigMap in place of the pod for tokens.
    assert len(found) == len(manifests())
    assert "Pod" not in {each["kind"] for each in found}
    for each in found:
        kubernetes_validate.validate(each, VERSIONS[-1], strict=True)
    # The generated name reaches the pod.
    generated = next(
        each["metadata"]["name"]
        for each in found
        if each["kind"] == "ConfigMap" and each["metadata"]["name"].startswith("fogbank-haproxy-")
    )
    pod = next(each for each in found if each["kind"] == "StatefulSet")["spec"]["template"]["spec"]
    assert generated in [volume.get("configMap", {}).get("name") for volume in pod["volumes"]]


def pods() -> dict[str, dict[str, Any]]:
    """Pods, and templates of pods by the name of what makes them."""
    return {
        each["metadata"]["name"]: each if each["kind"] == "Pod" else each["spec"]["template"]
        for each in manifests()
        if each["kind"] in ("StatefulSet", "Deployment", "Pod")
    }


def test_kubernetes_names_fit_together() -> None:
    labels = {name: pod["metadata"]["labels"] for name, pod in pods().items()}
    (server,) = (each for each in manifests() if each["kind"] == "StatefulSet")
    (claim,) = (template["metadata"]["name"] for template in server["spec"]["volumeClaimTemplates"])
    admin = manifest("Pod", "fogbank-admin")
    claims = [volume.get("persistentVolumeClaim", {}).get("claimName") for volume in admin["spec"]["volumes"]]
    assert f"{claim}-{server['metadata']['name']}-0" in claims
    for each in manifests():
        spec = each.get("spec", {})
        selectors = {
            "Service": lambda spec: spec["selector"],
            "PodDisruptionBudget": lambda spec: spec["selector"]["matchLabels"],
            "NetworkPolicy": lambda spec: spec["podSelector"]["matchLabels"],
            "StatefulSet": lambda spec: spec["selector"]["matchLabels"],
            "Deployment": lambda spec: spec["selector"]["matchLabels"],
        }
        if each["kind"] not in selectors:
            continue
        wanted = selectors[each["kind"]](spec)
        assert any(wanted.items() <= of_pod.items() for of_pod in labels.values()), each["metadata"]["name"]
    for name, pod in pods().items():
        volumes = {volume["name"] for volume in pod["spec"]["volumes"]}
        volumes |= {"data"} if name == "fogbank" else set()
        for container in pod["spec"]["containers"]:
            ports = {port["name"] for port in container.get("ports", [])}
            assert {mount["name"] for mount in container["volumeMounts"]} <= volumes
            for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
                asks = container.get(probe, {})
                port = asks.get("httpGet", asks.get("tcpSocket", {})).get("port")
                assert port is None or port in ports
            assert name == "fogbank-admin" or {"readinessProbe", "livenessProbe"} <= set(container)


def test_kubernetes_pods_have_no_rights() -> None:
    for pod in pods().values():
        spec = pod["spec"]
        assert spec["automountServiceAccountToken"] is False
        assert spec["securityContext"]["runAsNonRoot"] is True
        assert spec["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for container in spec["containers"]:
            context = container["securityContext"]
            assert context["readOnlyRootFilesystem"] is True
            assert context["allowPrivilegeEscalation"] is False
            assert context["capabilities"] == {"drop": ["ALL"]}
            assert "memory" in container["resources"]["limits"]


def test_memory_is_three_quarters_of_the_limit() -> None:
    """The server takes its own share of what --memory says, and sees the machine's memory and not the container's."""
    container = manifest("StatefulSet", "fogbank")["spec"]["template"]["spec"]["containers"][0]
    limit = container["resources"]["limits"]["memory"]
    assert f"--memory={int(limit.removesuffix('Gi')) * 3 // 4}" in container["args"]
    server = compose()["services"]["server"]
    command = server["command"]
    assert int(command[command.index("--memory") + 1]) == int(server["mem_limit"].removesuffix("g")) * 3 // 4


def test_prometheus_and_grafana_find_each_other() -> None:
    services = compose()["services"]
    command = services["server"]["command"]
    scraped = yaml.safe_load((DEPLOY / "monitoring" / "prometheus.yml").read_text())["scrape_configs"][0]
    assert scraped["static_configs"] == [{"targets": [command[command.index("--metrics") + 1]]}]
    provisioning = DEPLOY / "monitoring" / "grafana" / "provisioning"
    (source,) = yaml.safe_load((provisioning / "datasources" / "prometheus.yaml").read_text())["datasources"]
    listen = next(word for word in services["prometheus"]["command"] if word.startswith("--web.listen-address="))
    assert source["url"] == "http://" + listen.partition("=")[2]
    (provider,) = yaml.safe_load((provisioning / "dashboards" / "fogbank.yaml").read_text())["providers"]
    mounts = dict(mount.split(":")[:2] for mount in services["grafana"]["volumes"])
    folder = next(Path(source) for source, target in mounts.items() if target == provider["options"]["path"])
    dashboard = json.loads((DEPLOY / folder / "fogbank.json").read_text())
    assert all(panel["datasource"]["uid"] == source["uid"] for panel in dashboard["panels"])
