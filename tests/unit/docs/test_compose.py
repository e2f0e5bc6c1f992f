"""compose.yaml serves the runbooks where the links of mails lead."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

CHECKOUT = Path(__file__).parents[3]


def test_prometheus_serves_the_runbooks_that_mails_link_to():
    prometheus = yaml.safe_load((CHECKOUT / "compose.yaml").read_text())["services"]["prometheus"]
    [folder] = re.findall(r"--web\.user-assets=(\S+)", " ".join(prometheus["command"]))
    mounted = dict(each.split(":")[1::-1] for each in prometheus["volumes"])
    linked = (CHECKOUT / "alertmanager" / "templates" / "site.tmpl").read_text()
    [path] = re.findall(r"http://localhost:9090/user/(\w+)", linked)

    assert (CHECKOUT / mounted[folder] / path / "RosDiagnosticsRobotSilent.md").exists()
