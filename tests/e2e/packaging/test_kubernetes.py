"""packaging/kubernetes: built, checked against the published schemas, the pod's command run."""

import json
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent, indent
from typing import Any

import jsonschema
import kubernetes_validate
import pytest
import yaml

import prometheus_operator
from ros_diagnostics_exporter import __version__
from support.called import called
from support.go import go
from testbed import domains, http
from testbed.configuration import CHECKOUT
from testbed.polling import until

FOLDER = CHECKOUT / "packaging" / "kubernetes"
RULES = FOLDER / "rules" / "rules.yaml"
PAGE = (CHECKOUT / "docs" / "kubernetes.md").read_text()
OPERATOR = "github.com/prometheus-operator/prometheus-operator@v0.85.0"
KUSTOMIZE = "sigs.k8s.io/kustomize/kustomize/v5@v5.7.1"
VERSIONS = ("1.29", kubernetes_validate.latest_version())
MAX_ANNOTATIONS = 256 * 1024  # bytes; `kubectl apply` keeps the object in one


def objects(path: Path) -> list[dict[str, Any]]:
    return list(yaml.safe_load_all(path.read_text()))


def resources() -> Iterator[dict[str, Any]]:
    for kustomization in sorted(FOLDER.glob("*/kustomization.yaml")):
        for name in yaml.safe_load(kustomization.read_text())["resources"]:
            yield from objects(kustomization.parent / name)


def one(kind: str) -> dict[str, Any]:
    (found,) = (each for each in resources() if each["kind"] == kind)
    return found


def check(found: dict[str, Any]) -> None:
    """Raise unless Kubernetes' own schemas have this object, and no more than its keys."""
    for version in VERSIONS:
        kubernetes_validate.validate(found, version, strict=True)


def is_of_operator(found: dict[str, Any]) -> bool:
    return str(found["apiVersion"]).startswith("monitoring.coreos.com/")


def test_every_file_is_used_and_fits_kubernetes():
    used = {
        str(path.parent / name)
        for path in FOLDER.glob("*/kustomization.yaml")
        for name in [path.name, *yaml.safe_load(path.read_text())["resources"]]
    }
    there = {str(path) for path in FOLDER.rglob("*") if path.is_file()}
    assert there - used == {str(FOLDER / "base" / "fleet.yml")}
    for each in resources():
        assert len(json.dumps(each)) < MAX_ANNOTATIONS
        if not is_of_operator(each):
            check(each)


def test_the_service_and_its_monitor_select_the_pod():
    service, pod = one("Service"), one("StatefulSet")["spec"]["template"]
    (port,) = service["spec"]["ports"]
    (container,) = pod["spec"]["containers"]
    assert service["spec"]["selector"].items() <= pod["metadata"]["labels"].items()
    assert {"name": port["targetPort"], "containerPort": port["port"]} in container["ports"]
    monitor = one("ServiceMonitor")["spec"]
    assert monitor["selector"]["matchLabels"].items() <= service["metadata"]["labels"].items()
    scrapes = [(each["interval"], each["params"]) for each in monitor["endpoints"]]
    assert scrapes == list(prometheus_operator.SCRAPES.values())
    assert {each["port"] for each in monitor["endpoints"]} == {port["name"]}
    jobs = [each["relabelings"] for each in monitor["endpoints"]]
    assert jobs == [
        [{"targetLabel": "job", "replacement": job}] for job in prometheus_operator.SCRAPES
    ]


def test_the_pod_is_that_of_the_containerfile():
    pod = one("StatefulSet")["spec"]["template"]["spec"]
    containerfile = (CHECKOUT / "packaging" / "Containerfile").read_text()
    user = re.search(r"^USER (\d+):(\d+)$", containerfile, re.MULTILINE)
    assert user
    context = pod["securityContext"]
    assert (context["runAsUser"], context["runAsGroup"]) == (int(user[1]), int(user[2]))
    mounts = [each["mountPath"] for each in pod["containers"][0]["volumeMounts"]]
    volume = re.search(r"^VOLUME (\S+)$", containerfile, re.MULTILINE)
    assert volume
    assert volume[1] in mounts


class ConfigMap:
    """A folder as the kubelet makes it: links, exchanged in one step."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir()
        (folder / "fleet.yml").symlink_to("..data/fleet.yml")

    def update(self, text: str, version: str) -> None:
        (self._folder / f"..{version}").mkdir()
        (self._folder / f"..{version}" / "fleet.yml").write_text(text)
        (self._folder / "..data_tmp").symlink_to(f"..{version}")
        (self._folder / "..data_tmp").rename(self._folder / "..data")


def test_the_command_of_the_pod_runs_passes_the_probes_and_reads_a_new_config_map(
    tmp_path: Path, start_process, free_port: Callable[[], int], ros_domain: int
):
    (container,) = one("StatefulSet")["spec"]["template"]["spec"]["containers"]
    folders = {each["mountPath"]: tmp_path / each["name"] for each in container["volumeMounts"]}
    fleet = (FOLDER / "base" / "fleet.yml").read_text()
    fleet = fleet.replace("domain_ids: [0]", f"domain_ids: [{ros_domain}]")
    config = ConfigMap(folders["/etc/ros-diagnostics-exporter"])
    config.update(fleet, "first")
    folders["/var/lib/ros-diagnostics-exporter"].mkdir()
    arguments = []
    for each in container["args"]:
        flag, _, path = each.partition("=")
        parent = str(Path(path).parent)
        arguments.append(f"{flag}={folders[parent] / Path(path).name}")
    address = f"127.0.0.1:{free_port()}"
    command = Path(sys.executable).parent / "ros-diagnostics-exporter"
    argv = [command, *arguments, "--web.listen-address", address]
    exporter = start_process("exporter", argv, domains.environment(ros_domain))

    for name in ("startupProbe", "livenessProbe", "readinessProbe"):
        probe = container[name]["httpGet"]
        until(lambda path=probe["path"]: http.answers(address, path), exporter.describe)
        assert probe["port"] in {each["name"] for each in container["ports"]}
    config.update(fleet.replace("warehouse", "yokohama"), "second")

    until(lambda: http.get_json(address, "/api/v1/fleet")["fleet"] == "yokohama", exporter.describe)


def overlays(folder: Path) -> tuple[Path, Path]:
    """The overlay of docs/kubernetes.md, beside a checkout, and one for a second exporter."""
    (folder / "ros-diagnostics").symlink_to(CHECKOUT)
    text = re.search(r"```yaml\n# kustomization.yaml\n(.*?)```", PAGE, re.DOTALL)
    assert text
    second = text[1].replace("\nnamespace: ros-diagnostics\n", "\nnamespace: hall-2\n")
    second = second.replace("  - ../ros-diagnostics/packaging/kubernetes/rules\n", "")
    server = re.search(r"  ```yaml\n  # in the patch\n(.*?)  ```", PAGE, re.DOTALL)
    assert server
    second += indent(dedent(server[1]), "      ")  # the patch is the last key
    for name, content in (("site", text[1]), ("hall-2", second)):
        (folder / name).mkdir()
        (folder / name / "kustomization.yaml").write_text(content)
        (folder / name / "fleet.yml").write_text("fleet: yokohama\n")
    return folder / "site", folder / "hall-2"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_kustomize_builds_the_base_and_the_overlays_of_the_page(tmp_path):
    kustomize = shutil.which("kustomize")
    if kustomize is None:
        go("install", KUSTOMIZE, cwd=tmp_path, GOBIN=str(tmp_path))
        kustomize = str(tmp_path / "kustomize")

    def build(folder: Path) -> dict[tuple[str, str], dict[str, Any]]:
        done = called([kustomize, "build", folder])
        found = {(o["kind"], o["metadata"]["name"]): o for o in yaml.safe_load_all(done.stdout)}
        for each in found.values():
            if not is_of_operator(each):
                check(each)
        return found

    base = build(FOLDER / "base")
    site, second = map(build, overlays(tmp_path))

    assert base["ConfigMap", "ros-diagnostics-fleet"]["data"] == {
        "fleet.yml": (FOLDER / "base" / "fleet.yml").read_text()
    }
    assert site["ConfigMap", "ros-diagnostics-fleet"]["data"] == {"fleet.yml": "fleet: yokohama\n"}
    pod = site["StatefulSet", "ros-diagnostics-exporter"]["spec"]["template"]["spec"]
    assert pod["nodeSelector"] == {"kubernetes.io/hostname": "hall-1"}
    image = f"registry.example.org/ros-diagnostics-exporter:{__version__}"
    assert pod["containers"][0]["image"] == image
    assert pod["containers"][0]["args"][-1].startswith("--alertmanager.url=")
    of_operator = [each for each in site.values() if is_of_operator(each)]
    shipped = {
        each["metadata"]["name"]: each["spec"] for each in resources() if is_of_operator(each)
    }
    assert {each["metadata"]["name"]: each["spec"] for each in of_operator} == shipped
    for each in of_operator:
        assert each["metadata"]["namespace"] == "ros-diagnostics"
        assert each["metadata"]["labels"] == {"release": "prometheus"}
    pod = second["StatefulSet", "ros-diagnostics-exporter"]["spec"]["template"]["spec"]
    names = [each["name"] for each in pod["containers"][0]["env"]]
    assert names == ["ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"]
    assert {kind for kind, _ in second} == {kind for kind, _ in site} - {"PrometheusRule"}
    for (kind, _), each in second.items():
        assert each["metadata"]["name" if kind == "Namespace" else "namespace"] == "hall-2"


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_operators_objects_fit_its_own_definitions(tmp_path, capsys):
    module = json.loads(go("mod", "download", "-json", OPERATOR, cwd=tmp_path))
    definitions = Path(module["Dir"]) / "example" / "prometheus-operator-crd"
    prometheus_operator.main(["--servers", "--label=release=p", "--target=exporter:9877"])
    written = list(yaml.safe_load_all(capsys.readouterr().out))
    found = [*written, *(each for each in resources() if is_of_operator(each))]
    kinds = {each["kind"] for each in found}
    assert kinds == {"ServiceMonitor", "PrometheusRule", "ScrapeConfig"}
    for each in found:
        name = f"monitoring.coreos.com_{each['kind'].lower()}s.yaml"
        versions = yaml.safe_load((definitions / name).read_text())["spec"]["versions"]
        schema = strict(versions[0]["schema"]["openAPIV3Schema"])
        jsonschema.validate(each, schema)
        each["spec"]["unknown"] = True
        with pytest.raises(jsonschema.ValidationError, match="unknown"):
            jsonschema.validate(each, schema)


def strict(schema: Any) -> Any:
    """The same schema, in which a key without a name in it is an error, and ports may be texts."""
    if isinstance(schema, list):
        return [strict(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    changed = {key: strict(value) for key, value in schema.items()}
    if schema.get("x-kubernetes-int-or-string"):
        changed.pop("type", None)
    pattern = changed.get("pattern")
    if isinstance(pattern, str) and "(?i)" in pattern:  # Go allows it anywhere, Python at the start
        changed["pattern"] = "(?i)" + pattern.replace("(?i)", "")
    if isinstance(schema.get("properties"), dict) and "type" in schema:
        changed.setdefault("additionalProperties", False)
    return changed
