"""packaging/chart: built by helm, checked against Kubernetes' schemas and what else is shipped."""

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

import mixin
import prometheus_operator
from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.web import webconfig
from support.called import called
from support.committed_dashboards import BOARDS
from support.go import go
from testbed.configuration import CHECKOUT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

CHART = CHECKOUT / "packaging" / "chart"
KUBERNETES = CHECKOUT / "packaging" / "kubernetes"
VERSION = "v3.18.4"
OPERATOR = [f"--api-versions=monitoring.coreos.com/{version}" for version in ("v1", "v1alpha1")]
MAX_CONFIG_MAP = 1 << 20  # bytes
USERS = {"prometheus": "$2y$04$" + "a" * 53}
Objects = dict[tuple[str, str], dict[str, Any]]


@pytest.fixture(scope="session")
def helm(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The program: what is installed, or built once from its Go module."""
    if found := shutil.which("helm"):
        return found
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    folder = cache / "ros-diagnostics" / f"helm-{VERSION}"
    if not (folder / "helm").exists():
        module = f"helm.sh/helm/v3/cmd/helm@{VERSION}"
        go("install", module, cwd=tmp_path_factory.mktemp("go"), GOBIN=str(folder))
    return str(folder / "helm")


@pytest.fixture
def build(helm: str, tmp_path: Path) -> Callable[..., Objects]:
    """A function (options, values): the objects of a release named hall, by kind and name."""

    def built(*options: str, **values: Any) -> Objects:
        (tmp_path / "values.yaml").write_text(json.dumps(values))
        for command in (["lint", "--strict"], ["template", "hall"]):
            argv = [helm, *command, CHART, "--values", tmp_path / "values.yaml"]
            kubernetes = ["--kube-version=1.29"]
            more = options if command[0] == "template" else ()
            done = called([*argv, *kubernetes, *more])
        found = list(filter(None, yaml.safe_load_all(done.stdout)))
        for each in found:
            if not each["apiVersion"].startswith("monitoring.coreos.com/"):
                kubernetes_validate.validate(each, "1.29", strict=True)
        return {(each["kind"], each["metadata"]["name"]): each for each in found}

    return built


def base(kind: str) -> dict[str, Any]:
    """An object of the base for kustomize, or of its components."""
    files = ("base/exporter.yaml", "servicemonitor/servicemonitor.yaml")
    found = [each for f in files for each in yaml.safe_load_all((KUBERNETES / f).read_text())]
    (one,) = (each for each in found if each["kind"] == kind)
    return one


def test_without_an_operator_it_is_the_exporter_of_the_base_and_the_dashboards(build, tmp_path):
    found = build()

    boards = {
        key: each for key, each in found.items() if key[1].startswith("hall-ros-diagnostics-")
    }
    assert found.keys() - boards.keys() == {
        ("Service", "hall"),
        ("StatefulSet", "hall"),
        ("ConfigMap", "hall-fleet"),
    }
    pod = found["StatefulSet", "hall"]["spec"]["template"]["spec"]
    shipped = base("StatefulSet")["spec"]["template"]["spec"]
    assert pod["volumes"][0]["configMap"].pop("name") == "hall-fleet"
    shipped["volumes"][0]["configMap"].pop("name")
    assert pod == shipped
    assert pod["containers"][0]["image"].endswith(f":{__version__}")
    assert found["Service", "hall"]["spec"]["ports"] == base("Service")["spec"]["ports"]
    (tmp_path / "fleet.yml").write_text(found["ConfigMap", "hall-fleet"]["data"]["fleet.yml"])
    assert load(tmp_path / "fleet.yml").name == "robots"


def test_dashboards_are_the_shipped_ones_with_the_label_of_grafanas_sidecar(build):
    found = build(dashboards={"labels": {"grafana_dashboard": "yes"}})

    shown = {}
    for (_kind, name), each in found.items():
        if name.startswith("hall-ros-diagnostics-"):
            assert each["metadata"]["labels"]["grafana_dashboard"] == "yes"
            assert len(json.dumps(each)) < MAX_CONFIG_MAP
            shown |= {name: json.loads(text) for name, text in each["data"].items()}
    assert shown == {f"{uid}.json": board for uid, board in BOARDS.items()}
    assert not [name for _, name in build(dashboards={"enabled": False}) if "diagnostics" in name]


def test_with_an_operator_rules_and_scrapes_are_those_of_the_base(build):
    runbooks = "https://runbooks.example.org"
    labels = {"release": "prometheus"}
    found = build(
        *OPERATOR,
        monitorLabels=labels,
        rules={"runbooks": f"{runbooks}/"},
        targets=["exporter:9877"],
        scrape={"basicAuth": {"username": {"name": "s", "key": "u"}}},
    )

    monitor = found["ServiceMonitor", "hall"]["spec"]
    pod = found["StatefulSet", "hall"]["spec"]["template"]["metadata"]["labels"]
    assert monitor["selector"]["matchLabels"].items() <= pod.items()
    for endpoint in monitor["endpoints"]:
        assert endpoint.pop("basicAuth")["username"] == {"name": "s", "key": "u"}
    jobs = [each["relabelings"][0]["replacement"] for each in monitor["endpoints"]]
    assert sorted(jobs) == sorted(prometheus_operator.SCRAPES)
    shipped = base("ServiceMonitor")["spec"]["endpoints"]
    assert sorted(monitor["endpoints"], key=str) == sorted(shipped, key=str)
    of_operator = [
        *prometheus_operator.rules({}, servers=False, runbooks=runbooks),
        *prometheus_operator.scrapes({}, ["exporter:9877"]),
    ]
    for each in of_operator:
        name = "hall-" + each["metadata"]["name"]
        name = name if each["kind"] == "ScrapeConfig" else name.replace("ros-diagnostics-", "")
        one = found.pop((each["kind"], name))
        assert one["spec"] == each["spec"]
        assert one["metadata"]["labels"].items() >= labels.items()
    assert not [kind for kind, _ in found if kind in {"PrometheusRule", "ScrapeConfig"}]
    servers = {name for kind, name in build(*OPERATOR, rules={"servers": True})}
    assert "hall-servers" in servers
    assert {f"hall-{name}" for name, _ in mixin.groups()} <= servers


def test_the_web_config_is_a_secret_that_the_exporter_reads(build, tmp_path):
    found = build(webConfig={"basic_auth_users": USERS}, args=["--web.enable-lifecycle"])

    secret = found["Secret", "hall-web"]["stringData"]
    (name,) = secret
    (tmp_path / name).write_text(secret[name])
    assert webconfig.read(tmp_path / name).basic_auth_users == USERS
    pod = found["StatefulSet", "hall"]["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    mounted = {each["name"]: each["mountPath"] for each in container["volumeMounts"]}
    volumes = {each["name"]: each for each in pod["volumes"]}
    assert volumes["web"]["secret"]["secretName"] == "hall-web"
    assert f"--web.config.file={mounted['web']}/{name}" in container["args"]
    assert container["args"][-1] == "--web.enable-lifecycle"
    probes = [container[f"{kind}Probe"] for kind in ("startup", "liveness", "readiness")]
    assert all(each["tcpSocket"] == {"port": "metrics"} for each in probes)


def test_what_the_page_sets_is_in_the_objects(build):
    page = (CHECKOUT / "docs" / "kubernetes.md").read_text().partition("## With Helm")[2]
    (values,) = re.findall(r"```yaml\n# values.yaml\n(.*?)```", page, re.DOTALL)
    found = build(*OPERATOR, **yaml.safe_load(values))

    pod = found["StatefulSet", "hall"]["spec"]["template"]["spec"]
    assert pod["nodeSelector"] == {"kubernetes.io/hostname": "hall-1"}
    assert "yokohama" in found["ConfigMap", "hall-fleet"]["data"]["fleet.yml"]
    assert pod["containers"][0]["args"][-1].startswith("--alertmanager.url=")
