"""Forms of the real exporter at a real Alertmanager: acknowledge a fault, plan a downtime."""

import base64
import json
import re
import urllib.request
from datetime import datetime, timezone
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlencode

import bcrypt
import pytest

from ros_diagnostics_exporter.http_client import Client
from testbed import ports
from testbed.polling import until
from testbed.programs import MissingProgram
from testbed.servers import alertmanager, running

LOGIN = "Basic " + base64.b64encode(b"ann:secret").decode()


def ask(site, path: str, form: dict[str, str] | None = None) -> str:
    """A page, or the page that a form leads to."""
    body = None if form is None else urlencode(form).encode()
    address = f"http://127.0.0.1:{site.port}"
    request = urllib.request.Request(address + path, body, {"Authorization": LOGIN})
    with urllib.request.urlopen(request, timeout=20) as answer:
        return str(answer.read().decode())


def told(site, path: str) -> Any:
    return json.loads(ask(site, path))


def firing(fault: dict[str, Any]) -> dict[str, Any]:
    """The alert of a fault as Prometheus posts it."""
    names = ("scope", "state", "severity", "robot", "group", "component")
    since = datetime.fromtimestamp(fault["since"], timezone.utc)
    return {
        "labels": {
            **{name: fault[name] for name in names},
            "alertname": "RosDiagnosticsComponentCritical",
            "fleet": "hall",
            "fault": fault["fault"],
        },
        "annotations": {"evidence": f"since {since:%Y-%m-%d %H:%M:%S.%f}"[:-3] + " +0000 UTC"},
    }


def cancels(site, token: str) -> None:
    """Cancel the downtime that the robot's page shows; twice is once too often."""
    [last] = re.findall('name=until value="([0-9.]+)"', ask(site, "/robots/robot_1"))
    cancel = {"robot": "robot_1", "component": "Motor 2", "until": last}
    cancel |= {"token": token, "comment": "is back"}
    assert "The downtime is cancelled." in ask(site, "/-/cancel-downtime", cancel)
    with pytest.raises(HTTPError) as error:
        ask(site, "/-/cancel-downtime", cancel)
    assert "There is no such downtime any more." in error.value.read().decode()


def test_a_technician_acknowledges_a_fault_and_plans_a_downtime_with_a_browser(site):
    users = site.folder / "web.yml"
    hashed = bcrypt.hashpw(b"secret", bcrypt.gensalt(rounds=4)).decode()
    users.write_text(f"basic_auth_users: {{ann: {hashed}}}")
    config = site.folder / "alertmanager.yml"
    config.write_text("{route: {receiver: none}, receivers: [{name: none}]}")
    address = f"127.0.0.1:{ports.free_port()}"
    try:
        server = alertmanager(site.folder, config, address)
    except MissingProgram as missing:
        pytest.skip(str(missing))
    with running(server):
        flags = ["--alertmanager.url", f"http://{address}", "--web.enable-actions"]
        exporter = site.serve("--web.config.file", users, *flags)
        site.start_robots(1)
        until(lambda: told(site, "/api/v1/fleet")["robots"], exporter.describe, 60)
        until(lambda: "Motor 2" in ask(site, "/robots/robot_1"), exporter.describe, 60)
        site.fault("robot_1", "Motor 2", "error")
        until(lambda: told(site, "/api/v1/faults")["faults"], exporter.describe, 60)
        [fault] = told(site, "/api/v1/faults")["faults"]
        page = f"/faults/{fault['fault']}"
        token = re.findall('name=token value="([0-9a-f]+)"', ask(site, page))[0]
        form = {"token": token, "fault": fault["fault"], "comment": "new gears"}

        with pytest.raises(HTTPError) as error:  # nothing fires yet
            ask(site, "/-/acknowledge", form)
        assert error.value.code == 409
        Client(f"http://{address}").post("/api/v2/alerts", [firing(fault)])
        assert "Acknowledged. The page shows it" in ask(site, "/-/acknowledge", form)
        until(lambda: "acknowledged by ann: new gears" in ask(site, page), exporter.describe)
        with pytest.raises(HTTPError) as error:
            ask(site, "/-/acknowledge", form)
        assert "already acknowledged by ann" in error.value.read().decode()

        plan = {"robot": "robot_1", "component": "Motor 2", "from": "", "for": "30m"}
        plan |= {"token": token, "comment": "is taken out"}
        assert "The downtime is planned." in ask(site, "/-/downtime", plan)

        def downtimes() -> list[dict[str, Any]]:
            [robot] = told(site, "/api/v1/fleet")["robots"]
            return robot["downtimes"]

        until(downtimes, exporter.describe)
        [planned] = downtimes()
        assert (planned["component"], planned["author"]) == ("Motor 2", "ann")
        with pytest.raises(HTTPError):
            ask(site, "/-/downtime", plan | {"component": "No such"})

        cancels(site, token)
        until(lambda: not downtimes(), exporter.describe)

        actions = told(site, "/api/v1/events?kind=action")["events"]
        assert [each["after"] for each in actions] == ["cancelled", "downtime", "acknowledged"]
        assert {each["author"] for each in actions} == {"ann"}
        assert all("(from 127.0.0.1)" in each["message"] for each in actions)
