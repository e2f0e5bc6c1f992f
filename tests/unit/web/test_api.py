import socket
import threading
import time

import pytest

from ros_diagnostics_exporter.events import Event, EventLog
from ros_diagnostics_exporter.web import api
from ros_diagnostics_exporter.web.app import openapi
from support.web_server import ask, broken, component, fleet, robot

MOTOR = component("Motor 1", "ERROR")


def test_the_fleet_is_the_backends_snapshot(serve):
    expected = fleet(robot("robot_1", MOTOR), robot("robot_2"))
    answer = ask(serve(fleet_snapshot=lambda: expected), "/api/v1/fleet")
    assert answer.headers["Content-Type"] == "application/json"
    assert answer.json == expected


def test_the_fleet_can_be_filtered_by_robot(serve):
    server = serve(fleet_snapshot=lambda: fleet(robot("a"), robot("b"), robot("c d")))
    wanted = {"robot=b": ["b"], "robot=a&robot=c%20d": ["a", "c d"], "robot=x": []}
    for query, names in wanted.items():
        found = ask(server, f"/api/v1/fleet?{query}").json
        assert [each["robot"] for each in found["robots"]] == names
        assert found["fleet"] == "hall"


def test_numbers_that_json_does_not_have_are_null_and_any_string_is_encoded(serve):
    odd = component("Übermotor\n\ud800", "OK", flap_ratio=float("nan"))
    odd["values"] = [{"key": "R", "value": "inf", "number": float("inf"), "unit": None}]
    known = fleet(robot("r", odd), robot("é\ud800"))
    answer = ask(serve(fleet_snapshot=lambda: known), "/api/v1/fleet")
    assert "é?" in answer.text
    found = answer.json["robots"][0]["components"][0]
    assert (found["component"], found["flap_ratio"]) == ("Übermotor\n?", None)
    assert found["values"][0]["number"] is None


def test_a_snapshot_of_the_fleet_is_shared_for_a_second(serve):
    snapshots = []

    def snapshot():
        snapshots.append(1)
        return fleet(robot("a"))

    server = serve(fleet_snapshot=snapshot)
    for path in ("/api/v1/fleet", "/api/v1/fleet?robot=a", "/"):
        assert ask(server, path).status == 200
    assert len(snapshots) <= 2  # one, or two if this took longer than a second


def test_a_failed_snapshot_is_not_shared(serve):
    results = iter([RuntimeError("no"), fleet()])

    def snapshot():
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    server = serve(fleet_snapshot=snapshot)
    assert ask(server, "/api/v1/fleet").status == 500
    assert ask(server, "/api/v1/fleet").status == 200


def test_events_are_filtered_and_newest_first(serve):
    log = EventLog()
    log.record(Event(1.0, "level", "a", "/Motor", "Motor 1", "OK", "ERROR", "hot"))
    log.record(Event(2.0, "robot", "b", after="silent"))
    log.record(Event(3.0, "level", "a", "/Motor", "Motor 1", "ERROR", "OK", "fine"))
    server = serve(find_events=log.find)

    def times(query: str) -> list[float]:
        answer = ask(server, f"/api/v1/events{query}")
        assert answer.status == 200, answer.text
        return [event["time"] for event in answer.json["events"]]

    assert times("") == [3.0, 2.0, 1.0]
    assert times("?kind=robot") == [2.0]
    assert times("?robot=a&level=ERROR") == [1.0]
    assert times("?component=Motor%201&limit=1") == [3.0]
    assert times("?since=2&until=3") == [2.0]
    assert times("?before=3&limit=1") == [2.0]
    for number in range(4, 150):
        log.record(Event(float(number), "config"))
    assert len(times("")) == 100
    assert len(times("?limit=10000")) == 149


def test_events_since_a_time_ago(serve):
    log, now = EventLog(), time.time()
    for ago in (7_000, 500, 10):
        log.record(Event(now - ago, "robot", str(ago)))
    server = serve(find_events=log.find)

    def robots(query: str) -> list[str]:
        answer = ask(server, f"/api/v1/events?{query}")
        return [event["robot"] for event in answer.json["events"]]

    assert robots("since=10m") == ["10", "500"]
    assert robots("since=1h30m&until=1m") == ["500"]
    assert robots("since=1h57m") == ["10", "500", "7000"]
    assert robots(f"since={'9' * 400}w") == ["10", "500", "7000"]


def test_the_faults_are_the_backends(serve):
    lasting = {"fleet": "hall", "time": 1.0, "faults": [{**broken(), "labels": {}}]}
    server = serve(faults=lambda: lasting)
    assert ask(server, "/api/v1/faults").json == lasting
    rejected = ask(server, "/api/v1/faults?robot=a")
    assert (rejected.status, "'robot'; there is none" in rejected.text) == (400, True)


def test_pages_of_events_have_a_size_limit(serve, monkeypatch):
    monkeypatch.setattr(api, "PAGE_BYTES", 10_000)
    log = EventLog()
    for number in range(50):
        log.record(
            Event(float(number), "level", "a", message="é" * (6_000 if number == 7 else 500))
        )
    server, before, times, pages = serve(find_events=log.find), "", [], 0
    while True:
        answer = ask(server, f"/api/v1/events?limit=10000{before}")
        page = answer.json
        assert len(answer.body) < 10_100 or len(page["events"]) == 1
        pages += 1
        times += [event["time"] for event in page["events"]]
        if "next" not in page:
            break
        before = f"&before={page['next']}"
    assert times == [float(number) for number in reversed(range(50))]
    assert pages < 12


@pytest.mark.parametrize(
    ("path", "queries"),
    [
        ("/api/v1/events", "kind=x level=warn since=now until=nan limit=0 limit=1.5 limit=1_0 x=1"),
        ("/api/v1/events", f"limit=10001 before={2**53 + 2}"),
        ("/sd/node", "port=0 port=65536 port=ssh port=1.5 port="),
    ],
)
def test_an_invalid_parameter_is_rejected_by_name(plain, path, queries):
    for query in queries.split():
        answer = ask(plain, f"{path}?{query}")
        assert (answer.status, query) == (400, query)
        assert query.split("=")[0] in answer.json["error"]


def test_targets_are_the_backends_and_an_unknown_job_is_404(serve):
    group = {"targets": ["10.0.0.1:9100"], "labels": {"robot": "a"}}

    def targets(job: str, port: int | None):
        if job != "node":
            raise LookupError(f"no job {job}")
        if port == 1:
            raise ValueError("that port is not allowed")
        return [group | {"port": port}]

    server = serve(targets=targets)
    assert ask(server, "/sd/node").json == [group | {"port": None}]
    assert ask(server, "/sd/node?port=65535").json == [group | {"port": 65535}]
    assert "known are port" in ask(server, "/sd/node?x=1").text
    answer = ask(server, "/sd/node?port=1")
    assert (answer.status, answer.json) == (400, {"error": "that port is not allowed"})
    assert ask(server, "/sd/node").headers["Content-Type"] == "application/json"
    answer = ask(server, "/sd/nodes")
    assert (answer.status, answer.json) == (404, {"error": "no job nodes"})


def test_reload_is_forbidden_unless_the_lifecycle_api_is_enabled(serve):
    called = []
    server = serve(reload=lambda: called.append("reload"))
    assert ask(server, "/-/reload", "POST").status == 403
    assert ask(server, "/-/reload").status == 405
    assert called == []


def test_on_the_exporters_machine_a_person_may_forget_without_the_lifecycle_api(serve):
    called = []
    server = serve(forget=lambda *names: called.append(names) or (1, True))
    assert ask(server, "/-/forget?robot=a").status == 405
    proxied = ask(server, "/-/forget?robot=a", "POST", X_Forwarded_For="192.0.2.7")
    assert (proxied.status, called) == (403, [])
    assert ask(server, "/-/forget?robot=a", "POST").status == 200
    assert called == [("a", None)]


def test_a_failed_reload_returns_every_error(serve):
    def fail():
        raise ValueError("fleet.yml:3: robots[0].name: missing\nfleet.yml:9: x: unknown key")

    answer = ask(serve(reload=fail, lifecycle=True), "/-/reload", "POST")
    assert answer.status == 400
    assert answer.json["error"].count("fleet.yml:") == 2
    reloaded = ask(serve(lifecycle=True), "/-/reload", "PUT")
    assert (reloaded.status, reloaded.json) == (200, {"reloaded": True})


def test_accept_takes_what_the_graph_shows_of_a_robot(serve):
    called = []

    def accept(name):
        called.append(name)
        if name == "x":
            raise LookupError("nothing of robot 'x' was seen in the ROS graph")
        return 16

    server = serve(accept_graph=accept)
    path = "/-/watch/accept"
    assert ask(server, f"{path}?robot=a", "POST").json == {"expected": 16}
    assert ask(server, f"{path}?robot=a").status == 405
    proxied = ask(server, f"{path}?robot=a", "POST", X_Forwarded_For="192.0.2.7")
    assert proxied.status == 403
    assert ask(server, path, "POST").status == 400
    assert called == ["a"]
    missing = ask(server, f"{path}?robot=x", "POST")
    assert (missing.status, "ROS graph" in missing.body.decode()) == (404, True)


def test_forget_removes_a_robot_or_a_component(serve):
    removed = []

    def forget(name, part):
        if name != "a":
            raise KeyError(f"no robot {name!r}")
        removed.append((name, part))
        return 10, True

    server = serve(forget=forget, lifecycle=True)
    answer = ask(server, "/-/forget?robot=a&component=Motor%201", "POST")
    assert answer.json == {"forgotten": 10, "passed_on": True}
    assert ask(server, "/-/forget?robot=a", "POST").status == 200
    assert removed == [("a", "Motor 1"), ("a", None)]
    missing = ask(server, "/-/forget?robot=x", "POST", X_Forwarded_For="192.0.2.7")
    assert (missing.status, missing.json) == (404, {"error": "no robot 'x'"})
    assert ask(server, "/-/forget", "POST").status == 400


def test_a_change_is_visible_at_once(serve):
    known = [robot("a")]
    server = serve(
        fleet_snapshot=lambda: fleet(*known),
        forget=lambda *_: (len([known.pop()]), True),
        lifecycle=True,
    )
    assert b'"a"' in ask(server, "/api/v1/fleet").body
    assert ask(server, "/-/forget?robot=a", "POST").status == 200
    assert b'"a"' not in ask(server, "/api/v1/fleet").body


@pytest.mark.parametrize(
    ("site", "status"),
    [("cross-site", 403), ("same-site", 403), ("none", 200), ("same-origin", 200)],
)
def test_a_page_of_another_site_cannot_reload(serve, site, status):
    assert ask(serve(lifecycle=True), "/-/reload", "POST", Sec_Fetch_Site=site).status == status


# As browsers send it over plain HTTP to another host than localhost: without Sec-Fetch-Site.
@pytest.mark.parametrize("path", ["/-/reload", "/-/forget?robot=a", "/-/watch/accept?robot=a"])
@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "10.0.0.5:9877", "Origin": "http://evil.example"},
        {"Host": "10.0.0.5:9877", "Origin": "http://10.0.0.5"},  # another port
        {"Host": "10.0.0.5:9877", "Origin": "http://10.0.0.5:9877.evil.example"},
        {"Host": "10.0.0.5:9877", "Origin": "null"},  # a sandboxed frame, a file
        {"Host": "10.0.0.5:9877", "Origin": ""},
        {"Host": "10.0.0.5:9877", "Origin": "http://[evil"},
        {"Host": "10.0.0.5:9877", "Referer": "http://evil.example/10.0.0.5:9877"},
        {"Host": "10.0.0.5:9877", "Origin": "ftp://10.0.0.5:9877"},
        {"Host": "10.0.0.5:9877", "Origin": "http://evil.example", "Referer": "http://10.0.0.5:9877/"},
        # DNS rebinding: the page's own name was pointed here.
        {"Host": "evil.example:9877", "Origin": "http://evil.example:9877"},
        {"Host": "evil.example:9877", "Referer": "http://evil.example:9877/page"},
    ],
)  # fmt: skip
def test_a_page_of_another_site_cannot_change_anything_over_plain_http(serve, path, headers):
    called = []
    server = serve(
        reload=lambda: called.append("reload"),
        forget=lambda *_: called.append("forget"),
        accept_graph=lambda _robot: called.append("accept"),
        lifecycle=True,
    )
    answer = ask(server, path, "POST", **headers)
    assert (answer.status, called) == (403, [])
    assert "another site" in answer.json["error"]


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Host": "exporter.example.org"},  # a tool, which may use any name
        {"Host": "10.0.0.5:9877", "Origin": "http://10.0.0.5:9877"},
        {"Host": "[fd00::1]:9877", "Referer": "http://[FD00::1]:9877/"},
        {"Host": "localhost:9877", "Origin": "http://localhost:9877"},
        {"Host": "Exporter", "Origin": "https://exporter"},  # a proxy with TLS in front
        {"Host": "Exporter", "Origin": "http://exporter", "X_Forwarded_Proto": "https"},  # not read
        {"Host": f"{socket.gethostname()}:80", "Origin": f"http://{socket.gethostname()}:80"},
    ],
)
def test_tools_and_the_exporters_own_pages_can_reload(serve, headers):
    assert ask(serve(lifecycle=True), "/-/reload", "POST", **headers).status == 200


def test_errors_for_unknown_paths_and_methods_are_json(serve):
    server = serve()
    answer = ask(server, "/nothing/here")
    assert (answer.status, answer.json) == (404, {"error": "Not Found"})
    assert ask(server, "/metrics", "DELETE").status == 405


def test_notifications_are_given_to_the_backend_whole(serve):
    bodies = []

    def notified(body):
        bodies.append(body)
        return 2, 1

    server = serve(notified=notified)
    sent = b'{"a": "' + b"x" * 300_000 + b'"}'
    answer = ask(server, "/api/v1/notifications", "POST", body=sent)
    assert (answer.status, answer.json) == (200, {"recorded": 2, "ignored": 1})
    assert bodies == [sent]
    assert ask(server, "/api/v1/notifications").status == 405


def test_a_message_that_is_too_large_or_wrong_or_of_another_site_is_rejected(serve):
    def notified(_body):
        raise ValueError("not a message")

    server = serve(notified=notified)
    path = "/api/v1/notifications"
    description = openapi("/metrics")["paths"][path]["post"]["requestBody"]["description"]
    assert f"of at most {api.MAX_BODY / (1 << 20):g} MiB" in description
    assert ask(server, path, "POST", body=b"x" * (api.MAX_BODY + 1)).status == 413
    assert ask(server, path, "POST", body=b"x" * api.MAX_BODY).status == 400
    wrong = ask(server, path, "POST", body=b"{}")
    assert (wrong.status, wrong.json) == (400, {"error": "not a message"})
    assert ask(server, path, "POST", body=b"{}", Origin="http://evil.example").status == 403
    assert ask(server, f"{path}?receiver=x", "POST", body=b"{}").status == 400


def test_all_bodies_together_take_a_bounded_part_of_the_memory(serve, monkeypatch):
    monkeypatch.setattr(api, "MAX_BODIES", 1_000)
    server = serve()
    for _ in range(2):  # what was rejected is no longer counted
        assert ask(server, "/api/v1/notifications", "POST", body=b"x" * 1_001).status == 503
        assert ask(server, "/api/v1/notifications", "POST", body=b"x" * 1_000).status == 200


def test_why_is_the_backends_history(serve):
    asked = []

    def why(*given):
        asked.append(given)
        if given[0] != "r":
            raise LookupError(f"no robot {given[0]!r}")
        return {"entries": []}

    server = serve(why=why)
    assert ask(server, "/api/v1/why?robot=r&component=c&at=5").json == {"entries": []}
    assert asked == [("r", "c", 5.0)]
    missing = ask(server, "/api/v1/why?robot=x")
    assert (missing.status, missing.json) == (404, {"error": "no robot 'x'"})
    for query in ("", "?robot=", "?robot=r&at=soon", "?robot=r&x=1"):
        assert ask(server, f"/api/v1/why{query}").status == 400


def test_alertmanager_hanging_delays_no_other_request(serve):
    held = threading.Event()

    def why(robot, _component, _at, *, ask=True):
        assert not ask or held.wait(20)
        return {"entries": []}

    server = serve(why=why, fleet_snapshot=lambda: fleet(robot("r")))
    slow = threading.Thread(target=ask, args=(server, "/api/v1/why?robot=r"))
    slow.start()
    assert ask(server, "/robots/r").status == 200
    assert ask(server, "/-/ready").status == 200
    held.set()
    slow.join()


def test_a_recording_is_a_file_or_an_error_that_says_why_there_is_none(serve):
    def recording(fault, so_far):
        if fault != "0123456789ab":
            raise LookupError(f"no recording of fault {fault!r}")
        return b"\x89MCAP0\r\n" + b"so far" * so_far

    server = serve(recording=recording)
    found = ask(server, "/api/v1/faults/0123456789ab/recording.mcap")
    assert (found.status, found.body) == (200, b"\x89MCAP0\r\n")
    assert found.headers["Content-Disposition"] == 'attachment; filename="0123456789ab.mcap"'
    missing = ask(server, "/api/v1/faults/x/recording.mcap")
    assert (missing.status, missing.json) == (
        404,
        {"error": "no recording of fault 'x'"},
    )
    assert ask(server, "/api/v1/faults/x/recording.mcap?a=1").status == 400
    path = "/api/v1/faults/0123456789ab/recording.mcap?so_far="
    assert ask(server, path + "true").body == b"\x89MCAP0\r\nso far"
    assert ask(server, path + "false").body == b"\x89MCAP0\r\n"
    assert ask(server, path + "1").status == 400
