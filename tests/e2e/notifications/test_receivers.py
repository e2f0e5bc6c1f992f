"""What docs/receivers.md shows, on a real Alertmanager that posts to a server of this test."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

from support.alerts import fault, post_alerts
from support.loopback import Request, replying
from support.receivers_page import documented, written
from testbed import servers
from testbed.polling import until
from testbed.site import Site

# Where each service is: the key of its address.
ADDRESSES = {
    "pagerduty": "url",
    "opsgenie": "api_url",
    "slack": "api_url",
    "telegram": "api_url",
    "own": "url",
}
FAULT = {
    **fault("Motor 1", fault="a"),
    "annotations": {"summary": "Motor 1 of r1 is CRITICAL.", "evidence": "over current"},
}


def pointed_at(url: str, folder: Path) -> list[dict[str, Any]]:
    """The receivers of the page, with keys, and each at a path of its own below the address."""
    (folder / "key").write_text("secret")
    receivers = documented()
    for receiver in receivers:
        [[config]] = [configs for key, configs in receiver.items() if key != "name"]
        for key in [each for each in config if each.endswith("_file")]:
            config[key] = str(folder / "key")
        config.pop("api_url_file", None)
        config[ADDRESSES[receiver["name"]]] = f"{url}/{receiver['name']}/"
    return receivers


def test_a_problem_and_its_recovery_are_sent_by_each_service(site: Site) -> None:
    posted: defaultdict[str, list[str]] = defaultdict(list)  # by service

    def reply(request: Request) -> tuple[int, bytes]:
        service = request.path.split("/")[1].partition("?")[0]
        posted[service].append(f"{request.path} {request.body.decode()}")
        answer = json.dumps({"ok": True, "result": {"chat": {"id": 1}}}).encode()
        return 202 if service == "pagerduty" else 200, answer

    url = f"http://{site.use(replying(reply))}"
    file, address = written(site.folder, pointed_at(url, site.folder)), site.addresses.alertmanager
    site.start(servers.alertmanager(site.folder, file, address)).wait_until_ready()

    post_alerts(address, FAULT)
    until(lambda: set(posted) == set(ADDRESSES), "all services have the problem", 60)
    problems = {name: posts[0] for name, posts in posted.items()}
    post_alerts(address, FAULT, resolved=True)
    until(lambda: all(len(posts) > 1 for posts in posted.values()), "and the recovery", 60)

    assert all("over current" in problem for problem in problems.values())
    named = {"pagerduty": "resolve", "opsgenie": "/close", "own": '"resolved"'}
    for name, posts in posted.items():
        assert named.get(name, "RECOVERY") in posts[-1], name
