import base64
import hashlib
import re
import time
from html.parser import HTMLParser
from urllib.parse import quote, urldefrag, urljoin

import pytest
import yaml
from markupsafe import escape

from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from ros_diagnostics_exporter.severity import SUPPRESSED, state_of
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_exporter.web.pages import SCRIPT, landing, missing_robot, robot_page
from ros_diagnostics_exporter.web.runbooks import alert_of
from ros_diagnostics_exporter.web.search import MAX_FOUND
from support.committed_dashboards import BOARDS, ROOT
from support.shipped_rules import CENTRE_RULE_FILES, RULE_FILES, read_yaml
from support.web_server import (
    ask,
    broken,
    component,
    downtime,
    fleet,
    no_history,
    occurrence,
    problem,
    robot,
)

EVIL = "\"'><script>alert(1)</script><img src=x onerror=alert(1)>&amp;"
SILENT = {"up": False, "silent_reason": "mute"}
MUTE = problem("robot", "silent", since=900.0, confirmed=910.0)


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""

    @property
    def links(self) -> list[str]:
        return [attrs["href"] for tag, attrs in self.tags if tag == "a"]

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data.replace("\n", "")  # those between elements


def read(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    return reader


def test_all_texts_of_robots_are_escaped():
    values = [{"key": EVIL, "value": EVIL, "number": None, "unit": EVIL}]
    evil = robot(
        EVIL,
        component(EVIL, "ERROR", message=EVIL, group=EVIL, hardware_id=EVIL, values=values),
        silent_reason=EVIL,
        labels={EVIL: EVIL},
        topic=EVIL,
        address=EVIL,
        profile=EVIL,
        problems=[
            problem("component", "critical", component=EVIL, group=EVIL),
            problem("value", "warning", component=EVIL, key=EVIL, evidence=EVIL, confirmed=1.0),
            problem("check", "critical", check=EVIL, evidence=EVIL, suppressed=EVIL),
            problem("robot", "silent"),
        ],
    )
    common = [problem("site", "silent", site=EVIL), problem("common", "critical", component=EVIL)]
    given = fleet(evil, {**evil, "up": False}, problems=common)
    given = {**given, "fleet": EVIL, "version": EVIL}
    event = dict.fromkeys(("robot", "group", "component", "before", "after", "message"), EVIL)
    events = [{"id": 1, "time": 1.0, "kind": kind, **event} for kind in ("level", "robot")]
    for html in (
        landing(given, "/metrics"),
        robot_page(given, EVIL, events),
        missing_robot(given, EVIL),
    ):
        page = read(html)
        assert [tag for tag, _ in page.tags if tag in {"script", "img"}] == ["script"]
        assert html.count(SCRIPT) == 1
        assert all(not name.startswith("on") for _, attrs in page.tags for name in attrs)
        assert page.text.count(EVIL) >= 2


def test_the_page_loads_nothing_and_its_policy_forbids_it(serve):
    answer = ask(serve(fleet_snapshot=lambda: fleet(robot("a"))), "/")
    page = read(answer.text)
    assert not {tag for tag, _ in page.tags} & {"img", "link", "iframe"}
    assert not any("src" in attrs for _, attrs in page.tags)
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for tag, directive in (("style", "style-src"), ("script", "script-src")):
        inline = answer.text.partition(f"<{tag}>")[2].partition(f"</{tag}>")[0]
        allowed = base64.b64encode(hashlib.sha256(inline.encode()).digest()).decode()
        assert f"{directive} 'sha256-{allowed}'" in policy  # else the browser ignores it


def test_all_links_of_the_page_work(serve):
    server = serve(telemetry_path="/m", fleet_snapshot=lambda: fleet(robot("a")))
    links = read(ask(server, "/").text).links
    assert len(links) >= 6
    assert {ask(server, f"/{link}").status for link in links} == {200}


@pytest.mark.parametrize(
    "name", ["robot_1", "a b", "a/b", "a/../b", "50%25", "?x=1&y", "#1", "é\u202e", EVIL]
)
def test_each_robot_has_a_page_whose_links_work(serve, name):
    given = fleet(robot(name, component("Motor 1", "OK")), robot("other"))
    server = serve(fleet_snapshot=lambda: given)
    links = read(ask(server, "/").text).links
    (path,) = (each for each in links if each.startswith("robots/") and "other" not in each)
    assert path.count("/") == 1  # so that the links of that page are relative to the same place
    answer = ask(server, f"/{path}")
    assert answer.status == 200
    assert str(escape(one_line(name))) in answer.text
    links = read(answer.text).links
    assert len(links) >= 3
    for link in links:
        there = ask(server, urljoin(f"/{path}", link))
        assert there.status == 200
        if "fleet?" in link:
            assert [each["robot"] for each in there.json["robots"]] == [name]


def test_a_row_of_a_problem_links_its_runbook_why_and_the_forms(serve):
    known = robot("a/b", component("Motor 1", "ERROR"), problems=[broken(fault=FAULT)])
    soft = robot("c", problems=[broken("Motor 2", "warning", confirmed=None)])
    common = problem("common", "critical", component="Map", confirmed=1_010.0, fault="f0")
    given = fleet(known, soft, problems=[common])
    server = serve(fleet_snapshot=lambda: given)
    page = ask(server, "/").text
    assert "hall: Map of many robots" in ask(server, "/faults/f0").text
    runbook = "runbooks/RosDiagnosticsComponentCritical?robot=a%2Fb&amp;component=Motor+1"
    for link in (runbook, "robots/a%2Fb#why", "robots/c#why"):
        assert f'href="{link}"' in page
    assert page.count('<a href="runbooks/') == 3
    assert "#act" not in page  # nobody may act
    assert "#act" not in landing(given, "/metrics")
    acting = landing(given, "/metrics", acts=True)
    assert acting.count("#act") == 2  # what is not confirmed has no page
    assert f'href="faults/{FAULT}#act"' in acting


def test_the_page_of_a_fault_says_what_else_is_wrong(serve):
    common = problem("common", "critical", component="Map", confirmed=1_010.0, fault="f0")
    given = fleet(robot("a", problems=[broken("Motor 2", confirmed=None)]), problems=[common])
    server = serve(fleet_snapshot=lambda: given)
    assert "The fleet has" not in ask(server, "/faults/f0").text
    given["robots"].append(robot("b", problems=[broken(fault="f1")]))
    shown = '<a href="../">The fleet has one more fault, CRITICAL</a>'
    assert shown in ask(server, "/faults/f0").text
    given["robots"].append(robot("c", problems=[broken("Motor 2", "warning", fault="f2")]))
    shown = '<a href="../">The fleet has 2 more faults, 1 of them CRITICAL</a>'
    assert shown in ask(server, "/faults/f0").text


@pytest.mark.parametrize("suffix", ["", ".html", ".md"])
def test_a_runbook_is_a_page_with_the_names_filled_in(serve, suffix):
    given = fleet({**robot("robot_3"), "domain_id": 7, "topic": "/robot_3/diagnostics_agg"})
    names = "robot=robot_3&component=Motor%20%20%222%22"
    path = f"/runbooks/RosDiagnosticsComponentCritical{suffix}?{names}"
    server = serve(fleet_snapshot=lambda: given)
    answer = ask(server, path)
    page = read(answer.text)
    assert answer.status == 200
    assert "<h1>RosDiagnosticsComponentCritical</h1>" in answer.text
    assert "<h2>Do this now</h2>" in answer.text
    assert "ros-diagnostics why robot_3 'Motor  \"2\"'" in page.text
    assert '{robot="robot_3", component="Motor  \\"2\\""}' in page.text
    assert {"../robots/robot_3", "../"} <= {*page.links}

    silent = read(ask(server, "/runbooks/RosDiagnosticsRobotSilent?robot=robot_3").text).text
    assert "ROS_DOMAIN_ID=7 ros2 topic hz /robot_3/diagnostics_agg" in silent


@pytest.mark.parametrize("name", ["a\nrm", "-oProxyCommand=x", "", "\u202eb"])
def test_a_name_that_cannot_be_pasted_is_not_filled_in(serve, name):
    path = f"/runbooks/RosDiagnosticsClockOffset?robot={quote(name)}"

    assert "ssh ROBOT chronyc" in read(ask(serve(), path).text).text


def test_a_name_in_a_runbook_is_one_word_and_no_markup(serve):
    path = f"/runbooks/RosDiagnosticsClockOffset?robot={quote('<b>; x')}"
    html = ask(serve(), path).text

    assert "ssh '<b>; x' chronyc" in read(html).text
    assert "<b>" not in html


def test_the_links_of_all_runbooks_lead_to_runbooks(serve):
    server = serve()
    for page in (ROOT / "docs" / "alerts").glob("*.md"):
        path = f"/runbooks/{page.stem}"
        links = read(ask(server, path).text).links
        assert {ask(server, urljoin(path, link)).status for link in links} == {200}


def test_each_shipped_alert_has_a_runbook_below_its_name(serve):
    server = serve()
    rules = [
        rule
        for file in (*RULE_FILES, *CENTRE_RULE_FILES)
        for group in read_yaml(file)["groups"]
        for rule in group["rules"]
    ]
    names = {rule["alert"] for rule in rules if "alert" in rule}

    assert len(names) > 30
    assert [each for each in names if ask(server, f"/runbooks/{each}.html").status != 200] == []


def test_an_alert_without_a_runbook_is_404(serve):
    answer = ask(serve(), "/runbooks/DiskFull.html")
    assert answer.status == 404
    assert "the alert DiskFull." in read(answer.text).text


@pytest.mark.parametrize(
    ("query", "to"),
    [
        ("fault=0123&robot=a", "faults/0123"),
        ("fault=&robot=a/b c", "robots/a%2Fb%20c"),
        ("fault=//evil.example", "faults/%2F%2Fevil.example"),
        ("robot=..", "robots/.."),
        ("robot=\r\nX: y", "robots/%0D%0AX%3A%20y"),
        ("", "./"),
        ("fault=f&scope=component&state=stale", "runbooks/RosDiagnosticsComponentStale"),
        (
            "robot=a b&component=c&scope=component&state=stale",
            "runbooks/RosDiagnosticsComponentStale?robot=a+b&component=c",
        ),
        ("fault=0123&scope=&state=", "faults/0123"),
        ("scope=site&state=silent", "runbooks/RosDiagnosticsFleetPartDown"),
    ],
)
def test_a_dashboard_leads_to_a_problem_by_what_it_knows_and_to_no_other_site(serve, query, to):
    answer = ask(serve(), f"/problem?{quote(query, safe='=&')}")
    assert (answer.status, answer.headers["Location"]) == (303, to)


def test_the_runbook_of_a_fault_is_that_of_its_alert():
    rules = yaml.safe_load((ROOT / "prometheus/rules/faults.yml").read_text())
    found = {}
    for rule in (each for group in rules["groups"] for each in group["rules"]):
        of = re.search(r'scope="(\w+)"(?:, state="(\w+)")?', rule["expr"])
        if "alert" in rule and of:
            found[of[1], of[2] or ""] = rule["alert"]
    assert len(found) == 20
    assert {key: alert_of(*key) for key in found} == found
    assert alert_of("check", "short") == "RosDiagnosticsCheckShort"
    assert alert_of("", "") == alert_of("component", "x") == ""


FAULT = "0123456789ab"
RECORDING = f"/api/v1/faults/{FAULT}/recording.mcap"


def test_a_fault_has_a_page_and_links_what_was_received(serve):
    recorded = broken("Motor 1", fault=FAULT, recording=RECORDING, evidence="over current")
    given = fleet(robot("a", component("Motor 1", "ERROR"), problems=[recorded]))
    server = serve(fleet_snapshot=lambda: given, recording=lambda *_: b"mcap")
    for path in ("/", "/robots/a", f"/faults/{FAULT}"):
        answer = ask(server, path)
        assert answer.status == 200
        assert "Motor 1</a>" in answer.text
        links = read(answer.text).links
        assert {urljoin(path, link) for link in links} >= {f"/faults/{FAULT}", RECORDING}
        there = {urldefrag(urljoin(path, link)).url for link in links}
        found = {ask(server, link).status for link in there}
        assert found == {200}
    assert "<title>a: Motor 1</title>" in answer.text
    assert "fault of hall, /Motor/Motor 1, " in answer.text
    assert "When confirmed: over current" in read(answer.text).text


def test_a_fault_of_which_nothing_is_known_is_404_and_the_page_says_since_when(serve):
    answer = ask(serve(fleet_snapshot=lambda: fleet(robot("a"))), f"/faults/{FAULT}")
    assert (answer.status, answer.headers["Content-Type"]) == (404, "text/html; charset=utf-8")
    assert f"Nothing is known of fault {FAULT}" in read(answer.text).text
    assert "no events are kept. So faults that have ended are not known." in read(answer.text).text
    kept = no_history(FAULT) | {"events_since": 600.0}
    answer = ask(serve(fault_history=lambda _fault: kept), f"/faults/{FAULT}")
    assert answer.status == 404
    assert "The log goes back to 00:10:00 UTC. Faults thatended before" in read(answer.text).text


MOTOR = {"robot": "a", "group": "/Motor", "component": "Motor 1"}
ENDED = occurrence(
    "component",
    "critical",
    **MOTOR,
    evidence="over current",
    end="OK: runs",
    acknowledged=[{"at": 1_015.0, "author": "ann", "comment": "on it"}],
    notified=[
        {"at": 1_012.0, "receiver": "email", "step": "", "after": "firing"},
        {"at": 1_033.0, "receiver": "email", "step": "", "after": "resolved"},
    ],
)


def history(*ended: dict) -> dict:
    return no_history(FAULT) | {"events_since": 10.0, "occurrences": list(ended)}


OF_A = "ros-diagnostics-robot?var-fleet=hall&var-robot=a"  # its dashboard


def test_the_page_of_a_fault_that_has_ended_has_all_that_is_known_of_it(serve):
    server = serve(
        fleet_snapshot=lambda: fleet(robot("a")), fault_history=lambda _fault: history(ENDED)
    )
    answer = ask(server, f"/faults/{FAULT}")
    assert answer.status == 200
    shown = read(answer.text)
    for text in (
        "a: /Motor/Motor 1",
        "It has ended, 30 s ago.",
        "Since00:16:40 UTC",
        "Until00:17:10 UTC, for 30 s",
        "Confirmed00:16:50 UTC: over current",
        "Endrecovered: OK: runs",
        "Acknowledged00:16:55 UTC by ann: on it",
        "Notified00:16:52 UTC: notification sent to email",
        "Notified00:17:13 UTC: recovery sent to email",
    ):
        assert text in shown.text
    links = {urljoin(f"/faults/{FAULT}", link) for link in shown.links}
    assert links == {"/", "/robots/a", f"/api/v1/faults/{FAULT}"}
    assert {ask(server, link).status for link in links} == {200}


def test_a_fault_that_lasts_has_the_times_before_too_and_removed_is_no_recovery(serve):
    removed = ENDED | {"reason": "removed", "end": "", "since": 500.0, "until": 530.0}
    lasting = ENDED | {"until": None, "reason": None, "since": 1_050.0}
    given = fleet(robot("a", problems=[broken(fault=FAULT)]))
    server = serve(
        fleet_snapshot=lambda: given, fault_history=lambda _fault: history(lasting, ENDED, removed)
    )
    text = read(ask(server, f"/faults/{FAULT}").text).text
    assert "It has ended" not in text
    assert "Before: 2" in text
    assert text.count("Enda person or fleet.yml removed it") == 1
    assert text.count("Endrecovered: OK: runs") == 1


def test_the_times_that_a_fault_lasted_are_limited_on_its_page_and_escaped(serve):
    evil = ENDED | {"evidence": EVIL, "end": EVIL, "component": EVIL, "robot": EVIL}
    server = serve(fault_history=lambda _fault: history(*[evil] * 30))
    shown = read(ask(server, f"/faults/{FAULT}").text)
    assert [tag for tag, _ in shown.tags if tag in {"script", "img"}] == ["script"]
    assert shown.text.count("Since00:16:40 UTC") == 20
    assert "and 10 more times" in shown.text


def test_a_search_finds_robots_problems_and_messages_in_any_case(serve):
    over = broken("Motor 1")
    given = fleet(
        robot("Amr_1", component("Motor 1", "ERROR", message="over CURRENT"), problems=[over]),
        robot("amr_2", labels={"site": "Attic"}),
        robot("<3>"),
        problems=[problem("common", "critical", component="Map", confirmed=1_010.0)],
    )
    server = serve(fleet_snapshot=lambda: given)

    def found(text: str) -> set[str]:
        answer = ask(server, f"/?q={quote(text)}")
        assert answer.status == 200
        return {name for name in ("Amr_1", "amr_2", "<3>", "Map of many") if name in shown(answer)}

    def shown(answer) -> str:
        return read(
            answer.text.partition(
                "Faults of the whole fleet"
                if "of many robots" in answer.text
                else "Robots with problems"
            )[2]
        ).text

    assert found("AMR") == {"Amr_1", "amr_2"}
    assert found("current") == {"Amr_1"}
    assert found("attic") == {"amr_2"}
    assert found("<3>") == {"<3>"}
    assert found("map of") == {"Map of many"}
    assert found("nowhere") == set()
    field = next(each for tag, each in read(ask(server, "/?q=%3C3%3E").text).tags if tag == "input")
    assert field["value"] == "<3>"


def test_a_search_counts_what_it_found_and_nothing_else():
    given = fleet(
        robot("amr_1", component("Motor 1", "ERROR"), problems=[broken()]),
        robot("amr_2"),
        robot("arm", component("Motor 1", "ERROR"), problems=[broken()]),
    )

    def counts(query: str) -> str:
        page = landing(given, "/metrics", query).partition("<ul class=sum>")[2]
        return read(page.partition("</ul>")[0]).text

    assert counts("") == "2CRITICAL1OK"
    assert counts("amr") == "1CRITICAL1OK"
    assert counts("amr_2") == "1OK"
    assert counts("nowhere") == ""


def test_what_has_no_place_in_ros_is_listed_and_counts_as_no_robot():
    dock = robot("dock_1", component("battery", "ERROR"), domain_id=None, topic=None)
    given = fleet(robot("amr_1"), dock)
    html = landing(given, "/metrics")
    page = read(html).text
    assert read(html.partition("<ul class=sum>")[2].partition("</ul>")[0]).text == "1OK"
    assert "All robots: 1OK amr_1Not robots: 1CRITICAL dock_1" in page
    assert "None in domain" not in read(robot_page(given, "dock_1", ())).text


def test_a_search_finds_components_too_the_worst_first():
    lasers = component("Laser 1", "OK"), component("Laser 2", "STALE", message="<gone>")
    given = fleet(robot("a b", *lasers), robot("c", component("Motor 1", "ERROR")))
    page = landing(given, "/metrics", "LASER")

    assert "Components: 2STALE a b /Motor/Laser 2 " in read(page).text
    assert '<a href="robots/a%20b">' in page
    assert "&lt;gone&gt;" in page
    assert "Motor 1" not in page
    assert "Robots: 0" in page
    assert "Components:" not in landing(given, "/metrics")


def test_a_search_lists_so_many_components_and_counts_all():
    many = [component(f"Motor {number}", "OK") for number in range(MAX_FOUND + 7)]
    page = landing(fleet(robot("a", *many)), "/metrics", "motor")

    assert "Components: 107" in page
    assert "and 7 more components" in page
    assert page.count("<li class=well>") == MAX_FOUND


def test_a_page_has_landmarks_and_no_refresh_that_would_throw_focus_away():
    page = read(landing(fleet(robot("a")), "/metrics"))
    tags = [tag for tag, _ in page.tags]
    assert [tags.count(each) for each in ("header", "main", "footer", "h1")] == [1, 1, 1, 1]
    assert not [attrs for tag, attrs in page.tags if tag == "meta" and "http-equiv" in attrs]
    assert tags.count("noscript") == 1


@pytest.mark.parametrize(("name", "shown"), [("b%3Cb%3E", "b&lt;b&gt;"), ("a%0Ab", "a")])
def test_a_robot_that_there_is_not_is_404(serve, name, shown):
    answer = ask(serve(fleet_snapshot=lambda: fleet(robot("a"))), f"/robots/{name}")
    assert (answer.status, answer.headers["Content-Type"]) == (404, "text/html; charset=utf-8")
    assert f"There is no robot {shown}" in answer.text


def test_a_robot_that_is_removed_just_now_has_its_page(serve):
    def removed(*_given, **_more):
        raise LookupError("no robot 'a'")

    server = serve(fleet_snapshot=lambda: fleet(robot("a")), why=removed)
    assert ask(server, "/robots/a").status == 200


def test_a_robot_that_is_not_received_is_silent_and_one_never_seen_is_pending():
    ok, stale = component("x", "OK"), component("x", "STALE")
    warn, error = component("y", "WARN"), component("z", "ERROR")
    assert state_of(robot("a", ok)) == "OK"
    assert state_of(robot("a", ok, warn)) == "WARNING"
    assert state_of(robot("a", warn, stale)) == "STALE"
    assert state_of(robot("a", stale, error, warn)) == "CRITICAL"
    assert state_of(robot("a", error, **SILENT)) == "SILENT"
    assert state_of(robot("a", up=False, silent_reason="never_seen")) == "PENDING"
    assert state_of(robot("a", up=False, silent_reason="uplink_down")) == "UNREACHABLE"
    assert state_of(robot("a")) == "OK"


def text_of(*robots, **more) -> str:
    return read(landing(fleet(*robots, **more), "/metrics")).text


def test_problems_are_listed_worst_first_and_ok_robots_only_in_the_full_list():
    text = text_of(
        robot("fine", component("Motor 1", "OK")),
        robot("warned", component("Motor 2", "WARN"), problems=[broken("Motor 2", "warning")]),
        robot("silent", component("Motor 3", "STALE"), problems=[MUTE], **SILENT),
        robot(
            "broken",
            component("Motor 4", "ERROR", message="Over temperature"),
            problems=[broken("Motor 4")],
        ),
    )
    problems, _, everything = text.partition("All robots: 4")
    order = [problems.index(name) for name in ("broken", "silent", "warned")]
    assert order == sorted(order)
    assert "fine" not in problems
    assert "OK fine" in everything
    assert "1CRITICAL1SILENT1WARNING1OKRobots" in problems
    unjudged = text_of(robot("b10", component("Motor", "WARN")), robot("b9"))
    assert "Robots with problems: 1b10 WARNING" in unjudged
    assert "All robots: 2OK b9WARNING b10" in unjudged
    assert ("CRITICAL Motor 4 confirmed since 00:16:40 UTC, for 1 minOver temperature") in problems
    assert (
        "SILENT robot is silent confirmed since 00:15:00 UTC, for 2 min"
        "its publisher sends nothing (mute)"
    ) in problems
    assert "Motor 3" not in problems  # of a silent robot everything is stale
    starting = problem("robot", "silent", suppressed="restart")
    text = text_of(robot("a", problems=[starting], **SILENT))
    assert "not received since the exporter started" in text
    assert "its publisher sends nothing" not in text


def test_robots_whose_problems_are_all_suppressed_come_last_and_unconfirmed_ones_before():
    def given(name: str, **changed) -> dict:
        return robot(name, component("Motor 1", "ERROR"), problems=[broken(**changed)])

    text = text_of(
        given("a_suppressed", confirmed=None, suppressed="common"),
        given("b_soft", confirmed=None),
        given("c"),
        robot("d", component("Motor 2", "WARN"), problems=[broken("Motor 2", "warning")]),
    )
    expected = ("c CRITICAL", "b_soft CRITICAL", "d WARNING", "a_suppressed CRITICAL")
    order = [text.index(name) for name in expected]
    assert order == sorted(order)


def test_a_problem_is_confirmed_or_not_yet_or_suppressed_with_the_reason():
    def shown(**changed) -> str:
        given = robot("a", component("Motor 1", "ERROR"), problems=[broken(**changed)])
        text = text_of({**given, "maintenance": True, "maintenance_until": 72_000.0})
        return text.partition("CRITICAL Motor 1 ")[2].partition(" since ")[0]

    assert shown() == "confirmed"
    assert shown(confirmed=None) == "not confirmed yet, 5 s left"
    assert shown(confirmed=None, due=2_000.0) == "not confirmed yet, 15 min left"
    assert shown(confirmed=None, due=1_060.0) == "not confirmed yet"
    for reason, words in SUPPRESSED.items():
        if reason != "maintenance":
            assert shown(confirmed=None, suppressed=reason) == f"suppressed: {words}"
    assert (
        shown(confirmed=None, suppressed="maintenance") == "suppressed: maintenance until 20:00 UTC"
    )
    assert shown(suppressed="flapping", healthy=True) == (
        "recovered; it stays open: it is flapping"
    )


def test_a_milder_problem_that_goes_on_under_a_worse_one_is_not_listed():
    def shown(given) -> list[str]:
        return re.findall("(?:CRITICAL|WARNING) Motor 1 ", text_of(given))

    motor = component("Motor 1", "ERROR")
    problems = [broken(), broken(state="warning"), broken("Motor 2", "warning")]
    assert len(shown(robot("a", motor, problems=problems))) == 1
    problems[0] = broken(healthy=True, suppressed="flapping")
    assert len(shown(robot("a", motor, problems=problems))) == 2
    many = [problem("robot", "many", severity=each) for each in ("critical", "warning")]
    assert text_of(robot("a", motor, problems=many)).count("many components failed at once") == 1


def test_what_is_flapping_is_so_in_all_of_its_levels_and_maintenance_is_marked():
    flapping = problem(
        "flapping", "flapping", group="/Motor", component="Motor 1", confirmed=1_010.0
    )
    given = robot("a", component("Motor 1", "OK"), problems=[flapping])
    text = text_of(given, robot("b", maintenance=True, maintenance_until=90_000.0, problems=[MUTE]))
    assert "a FLAPPING" in text
    assert "flapping: 25% of its last states were changes" in text
    bad = component("Motor 1", "ERROR")
    assert state_of(robot("a", bad, problems=[flapping])) == "FLAPPING"
    assert (
        state_of(robot("a", bad, component("Motor 2", "WARN"), problems=[flapping])) == "FLAPPING"
    )
    assert state_of(robot("a", bad, component("Arm", "ERROR"), problems=[flapping])) == "CRITICAL"
    assert state_of(robot("a", bad, problems=[{**flapping, "confirmed": None}])) == "CRITICAL"
    comes_and_goes = problem("robot", "flapping", confirmed=1_010.0)
    assert state_of(robot("a", problems=[comes_and_goes])) == "FLAPPING"
    assert state_of(robot("a", **SILENT, problems=[comes_and_goes])) == "FLAPPING"
    behind = {"up": False, "silent_reason": "uplink_down"}
    assert state_of(robot("a", **behind, problems=[comes_and_goes])) == "UNREACHABLE"
    page = robot_page(fleet(robot("a", bad, problems=[flapping])), "a", ())
    assert "FLAPPING /Motor/Motor 1" in read(page).text.partition("Components: 1")[2]
    assert "maintenance until 1970-01-02 01:00 UTC" in text
    given = robot(
        "a",
        component("Motor 1", "OK"),
        problems=[MUTE],
        downtimes=[downtime("Motor 1"), downtime()],
    )
    text = text_of({**given, "maintenance": True, "maintenance_until": 80_000.0})
    assert "maintenance until 22:13 UTC (ann: new gears)" in text
    assert "Motor 1: maintenance until 22:13 UTC (ann: new gears; ann: new gears)" in text


def test_what_is_wrong_with_a_part_of_the_exporter_is_said_before_it_is_confirmed():
    why = "it does not answer: acknowledgements and downtimes are not followed"
    own = problem("exporter", "warning", component="Alertmanager", evidence=why)
    text = text_of(robot("a"), problems=[own])
    assert "exporter: Alertmanager not confirmed yet, 5 s left" in text
    assert why in text


def test_what_many_robots_have_in_common_comes_first():
    site = problem("site", "silent", site="hall", confirmed=1_010.0, evidence="robots: a, b")
    text = text_of(robot("a", problems=[MUTE], **SILENT), problems=[site])
    assert (
        "Faults of the whole fleet: 1SILENT many robots of site hall are silent confirmed" in text
    )
    assert text.index("of site hall") < text.index("Robots with problems")


def test_a_silent_robots_earlier_fault_is_still_shown():
    stale = component("Motor 1", "STALE", level_before_stale="ERROR", state="CRITICAL")
    given = robot("a", stale, problems=[MUTE, broken()], **SILENT)
    assert "STALE, counts as CRITICAL (was ERROR): Motor 1 reports" in text_of(given)


def test_a_robots_page_has_its_facts_and_the_newest_of_what_happened(monkeypatch):
    monkeypatch.setenv("TZ", "America/New_York")  # pages have UTC
    time.tzset()
    planned = component("Motor 1", "STALE", planned_stale=True)
    texts = [component("a", "OK", message="x" * 300), component("b", "OK", message="y" * 301)]
    known = robot("r", planned, *texts, **SILENT, address="10.0.0.1", last_message=1_050.0)
    of = {"kind": "robot", "robot": "r", "after": "silent"}
    events = [{"id": number, "time": 1_000.0 - number, **of} for number in range(60)]
    history = [{"time": 1_000.0, "text": f"step {number}."} for number in range(60)]
    page = robot_page(fleet(known), "r", events, history) or ""
    monkeypatch.undo()
    time.tzset()
    text = read(page).text
    for shown in (
        "Last message10 s ago, 00:17:30 UTC; silent: its publisher sends nothing (mute)",
        "Topic/r/diagnostics_agg in domain 7ProfiledefaultAddress10.0.0.1sitehall",
        "STALE /Motor/Motor 1 planned STALE (was OK)",
    ):
        assert shown in text
    assert ("x" * 300 + "…" in text, "y" * 300 + "…" in text) == (False, True)
    assert (text.count("robot is silent"), "00:15:50 UTC" in text) == (50, False)
    assert (text.count("step"), "step 10." in text, "step 9." in text) == (50, True, False)
    never = read(robot_page(fleet(robot("r", last_message=None)), "r", []) or "").text
    assert "Last messagenever" in never


def test_what_the_fleet_and_a_robot_can_do_is_shown_the_worst_first():
    def able(name: str, state: str, **robots: int) -> dict:
        none = dict.fromkeys(("ok", "degraded", "lost", "unknown", "maintenance"), 0)
        return {"capability": name, "state": state, "robots": none | robots}

    see, drive = able("see", "ok", ok=2), able("drive", "degraded", ok=1, degraded=1, maintenance=3)
    given = fleet(robot("a")) | {"capabilities": [see, drive, able("lift", "lost", lost=1)]}
    assert (
        "Robots with problems: 0None.CapabilitiesCRITICAL lift lost  0 of 1 robots can, 1 lost"
        "WARNING drive degraded  2 of 5 robots can, 3 in maintenance"
        "OK see 2 of 2 robots canAll robots"
    ) in read(landing(given, "/metrics")).text
    assert "Capabilities" not in landing(given, "/metrics", "a")
    motor = {"group": "/Motor", "component": "Motor 1", "check": "", "key": "", "robot": ""}
    able_to = [
        {"capability": "see", "state": "ok", "parts": []},
        {"capability": "drive", "state": "lost", "parts": [motor]},
    ]
    text = read(robot_page(fleet(robot("a", capabilities=able_to)), "a", []) or "").text
    assert "None.CapabilitiesCRITICAL drive lost  /Motor/Motor 1OK see" in text  # after problems


def test_the_size_of_the_pages_is_limited():
    values = [{"key": "&" * 1_000, "value": "&" * 1_000, "number": None, "unit": ""}] * 100
    many = [
        component(f"Motor {n}", "ERROR", message="&" * 100_000, values=values) for n in range(600)
    ]
    bad = [broken(f"Motor {n}", evidence="&" * 4_000) for n in range(30)]
    given = fleet(*(robot(f"robot_{n}", *many, problems=bad) for n in range(300)))
    page = landing(given, "/metrics")
    assert "and 100 more robots with problems" in page
    assert "and 20 more problems" in page
    assert len(page) < 6_000_000
    one = robot_page(given, "robot_1", [])
    assert one is not None
    assert "and 100 more components" in one
    assert len(one) < 5_000_000


def test_what_a_condition_suppresses_is_no_trouble_and_its_problem_says_why():
    suppressed = {"confirmed": None, "suppressed": "condition", "because": "unless Charger is OK"}
    motor = component("Motor 1", "ERROR", suppressed_because="unless Charger is OK")
    value = problem(
        "value", "critical", group="/Motor", component="Motor 2", key="Level", **suppressed
    )
    given = robot("a", motor, problems=[broken(**suppressed), value])
    assert state_of(given) == "OK"
    text = text_of(given)
    assert "suppressed: by its condition in fleet.yml, unless Charger is OK since" in text
    page = robot_page(fleet(given), "a", [])
    assert page is not None
    assert "<span class=mark>suppressed</span>" in page


def test_a_failed_check_is_critical_as_a_fault_and_shows_the_numbers():
    short = {"check": "motors", "patterns": [], "found": 1, "expected": 2}
    missing = problem("check", "critical", check="motors")
    given = robot("a", component("Motor 1", "OK"), short_checks=[short], problems=[missing])
    assert state_of(given) == "OK"
    fault = {**missing, "confirmed": 1_000.0}
    assert state_of({**given, "problems": [fault]}) == "CRITICAL"
    assert "check motors not confirmed yet, 5 s left" in text_of(given)
    assert "finds 1 of 2" in text_of(given)


def test_a_value_beyond_its_threshold_is_the_robots_state_as_a_fault_and_shows_both_numbers():
    low = {"bound": "low", "severity": "critical", "value": 13.0}
    battery = component("Battery", "OK")
    battery["values"][0]["thresholds"] = [low]
    beyond = problem(
        "value", "critical", group="/Motor", component="Battery", key="Level", bound="low"
    )
    given = robot("a", battery, problems=[beyond])
    assert state_of(given) == "OK"
    assert state_of({**given, "problems": [{**beyond, "confirmed": 1_000.0}]}) == "CRITICAL"
    assert " Battery: Level not confirmed yet" in text_of(given)
    assert "12.3 V, low threshold 13" in text_of(given)
    page = read(robot_page(fleet(given), "a", []) or "").text
    assert "CRITICAL /Motor/Battery" in page.partition("Components: 1")[2]
    assert "12.3 V (low critical 13)" in page


def test_a_robots_page_has_its_components_problems_first_and_its_events():
    log = EventLog()
    log.record(Event(1_000.0, "level", "a", "/Motor", "Motor 2", "OK", "ERROR", "hot"))
    fault = {"scope": "component", "state": "critical", "severity": "critical"}
    of = {"robot": "a", "group": "/Motor", "component": "Motor 2", **fault}
    log.record(Event(1_010.0, "fault_began", message="hot", since=1_000.0, **of))
    log.record(Event(1_020.0, "fault_ended", reason="recovered", since=1_000.0, **of))
    log.record(Event(1_040.0, "robot", "a", after="silent"))
    given = robot(
        "a",
        component("Motor 1", "OK"),
        component("Motor 2", "ERROR"),
        problems=[broken("Motor 2", evidence="Motor 2 reports ERROR; values: Level: 13 V")],
    )
    text = read(robot_page(fleet(given), "a", log.find(Wanted(robot="a"))) or "").text
    assert "When confirmed: Motor 2 reports ERROR; values: Level: 13 V" in text
    components, _, events = text.partition("Components: 2")[2].partition("Recent events")
    assert components.index("CRITICAL /Motor/Motor 2") < components.index("OK /Motor/Motor 1")
    assert components.count("12.3 V") == 1  # values of what is in trouble
    assert "00:17:20 UTC, 20 s ago robot is silent" in events
    assert "50 s ago fault began: CRITICAL /Motor/Motor 2: hot" in events
    assert "40 s ago fault recovered: CRITICAL /Motor/Motor 2" in events
    assert "00:16:40 UTC, 1 min ago /Motor/Motor 2 OK → ERROR: hot" in events
    assert events.index("silent") < events.index("hot")


def test_a_robots_page_has_who_takes_care_of_a_problem_and_the_history_of_its_faults():
    taken = {"author": "ann", "comment": "<spare part>", "at": 1_000.0, "until": 9_000.0}
    entries = [{"time": 1_001.0, "text": "notification sent to <email>"}]

    def page(problem: dict, history: list[dict]) -> str:
        of = fleet(robot("r", component("Motor 1", "ERROR"), problems=[problem]))
        return robot_page(of, "r", [], history) or ""

    shown = page(broken(notified={"email": 1_000.0}, acknowledged=taken), entries)
    assert "acknowledged by ann: &lt;spare part&gt;; notified 1 min ago: email</span>" in shown
    assert "00:16:41 UTC</span> notification sent to &lt;email&gt;</li>" in shown
    shown = page(broken(confirmed=None, suppressed="common"), [])
    assert "for 1 min; one notification for all</span>" in shown
    assert "History" not in shown


def test_a_query_without_an_answer_is_shown_with_the_words_of_prometheus():
    asked = {"name": "Host/load", "expr": "up", "rows": 3, "skipped": 0, "error": ""}
    wrong = {**asked, "name": "Host/wrong", "error": f"Prometheus answered 400: parse error {EVIL}"}
    page = landing({**fleet(robot("r")), "queries": [asked, wrong]}, "/metrics")

    assert "Queries without an answer: 1" in page
    assert "Host/wrong: Prometheus answered 400: parse error" in page
    assert "Host/load" not in page
    assert EVIL not in page
    assert "Queries without" not in landing(fleet(robot("r")), "/metrics")


def test_what_is_among_the_last_faults_in_order_is_not_listed_again():
    log = EventLog()
    for at, after in ((1_000.0, "silent"), (1_040.0, "received")):
        log.record(Event(at, "robot", "a", after=after))
    text = event_text(next(iter(log.find(Wanted(robot="a")))))
    entries = [{"time": 1_040.0, "text": text}]

    page = robot_page(fleet(robot("a")), "a", log.find(Wanted(robot="a")), entries) or ""

    assert page.count(text) == 1
    _, others = read(page).text.split("Other recent events")
    assert "is silent" in others


def test_a_robots_page_has_the_links_of_fleet_yml():
    links = {"manual": "https://w/?a=1&b=2", "<x>": 'http://h/"'}
    page = robot_page(fleet(robot("r", links=links)), "r", []) or ""

    assert '<a href="https://w/?a=1&amp;b=2" rel=noreferrer>manual</a>' in page
    assert '<a href="http://h/&#34;" rel=noreferrer>&lt;x&gt;</a>' in page
    assert 'aria-label="Links"' not in (robot_page(fleet(robot("r")), "r", []) or "")


@pytest.mark.parametrize(
    ("path", "dashboard"),
    [
        ("/", "ros-diagnostics-fleet?var-fleet=hall"),
        ("/?q=a", "ros-diagnostics-fleet?var-fleet=hall"),
        ("/robots/a", "ros-diagnostics-robot?var-fleet=hall&var-robot=a"),
        ("/faults/lasts", f"{OF_A}&from=100000&to=now"),
        ("/faults/ended", f"{OF_A}&from=100000&to=1930000"),
        ("/faults/site", "ros-diagnostics-fleet?var-fleet=hall&from=100000&to=now"),
    ],
)
def test_a_page_links_the_dashboard_of_what_it_shows_at_that_time(serve, path, dashboard):
    known = {
        "fleet_snapshot": lambda: fleet(
            robot("a", problems=[broken(fault="lasts")]),
            problems=[problem("site", "silent", fault="site")],
        ),
        "fault_history": lambda fault: history(*[ENDED] * (fault == "ended")),
    }

    def linked(**given: str) -> list[str]:
        links = read(ask(serve(**given, **known), path).text).links
        return [each for each in links if each.startswith("https://g")]

    assert linked(grafana="https://g/sub/") == [f"https://g/sub/d/{dashboard}"]
    assert linked() == []
    assert dashboard.partition("?")[0] in BOARDS
