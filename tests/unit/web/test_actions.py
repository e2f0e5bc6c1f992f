"""Forms by which who has logged in acts: what is followed, and what is rejected before anything."""

import base64
import http.client
import logging
import re
import time
from contextlib import closing
from html import unescape
from pathlib import Path
from urllib.parse import urlencode

import bcrypt
import pytest

from ros_diagnostics_exporter.model import Person
from ros_diagnostics_exporter.web.actions import MAX_FORM
from ros_diagnostics_exporter.web.webconfig import WebConfigError
from support.web_server import Reply, ask, broken, component, downtime, fleet, robot

FAULT = "0123456789ab"
HASHES = {
    name: bcrypt.hashpw(name.encode() * 2, bcrypt.gensalt(rounds=4)).decode()
    for name in ("ann", "bob")
}


def login(user: str) -> str:
    return "Basic " + base64.b64encode(f"{user}:{user * 2}".encode()).decode()


class Site:
    """A server with forms, and what its backend was asked to do."""

    def __init__(self, serve, folder: Path, **more) -> None:
        users = folder / "web.yml"
        users.write_text(f"basic_auth_users: {HASHES}")
        self.done: list[tuple] = []
        known = robot(
            "a",
            component("Motor 1", "ERROR"),
            problems=[broken(fault=FAULT)],
            downtimes=[downtime(), downtime("<Motor> 1", until=72_000.25)],
        )
        given = {
            "fleet_snapshot": lambda: fleet(known),
            "acknowledge": lambda *given: self.done.append(given),
            "plan_downtime": lambda *given: self.done.append(given),
            "cancel_downtime": lambda *given: self.done.append(given),
            "actions": True,
        }
        self.server = serve(web_config=users, **(given | more))

    def page(self, path: str, user: str = "ann") -> Reply:
        return ask(self.server, path, Authorization=login(user))

    def token(self, user: str = "ann", path: str = f"/faults/{FAULT}") -> str:
        return re.findall(r'name=token value="([0-9a-f]{64})"', self.page(path, user).text)[0]

    def post(self, path: str, fields: dict[str, str] | bytes, user: str = "ann", **more: str):
        body = fields if isinstance(fields, bytes) else urlencode(fields).encode()
        kind = {"Content_Type": "application/x-www-form-urlencoded", "Authorization": login(user)}
        headers = {name: text for name, text in (kind | more).items() if text}
        return ask(self.server, path, "POST", body=body, **headers)

    def acknowledge(self, user: str = "ann", *, form: dict[str, str] | None = None, **headers: str):
        """Post the form of the fault's page as ``user``, but for what is changed."""
        sent = {"token": self.token(), "fault": FAULT, "comment": "on  it"} | (form or {})
        return self.post("/-/acknowledge", sent, user, **headers)


@pytest.fixture
def site(serve, tmp_path):
    return Site(serve, tmp_path)


def test_a_form_acknowledges_a_fault_in_the_name_of_who_has_logged_in(site):
    answer = site.acknowledge(Sec_Fetch_Site="same-origin")
    assert (answer.status, answer.headers["Location"]) == (
        303,
        f"../faults/{FAULT}?done=acknowledged",
    )
    assert site.done == [(FAULT, Person("ann", "on it", "127.0.0.1"))]
    shown = site.page(f"/faults/{FAULT}?done=acknowledged")
    assert "<p role=status class=done>Acknowledged." in shown.text
    assert "role=status class=done" not in site.page(f"/faults/{FAULT}?done=<script>").text


@pytest.mark.parametrize(("part", "of"), [("", ""), ("Motor 1", "Motor 1")])
def test_a_form_plans_a_downtime_of_a_robot_or_a_component(site, part, of):
    form = {"token": site.token(path="/robots/a"), "robot": "a", "component": part, "for": "2h"}
    form |= {"from": "", "comment": "new gears"}
    before = time.time()
    answer = site.post("/-/downtime", form)
    assert (answer.status, answer.headers["Location"]) == (303, "../robots/a?done=downtime")
    [(robot_of, of_part, begin, seconds, person)] = site.done
    assert (robot_of, of_part, seconds) == ("a", of, 7_200.0)
    assert before <= begin <= time.time()
    assert person == Person("ann", "new gears", "127.0.0.1")
    answer = site.post("/-/downtime", form | {"for": "900d"})
    assert (answer.status, len(site.done)) == (400, 1)


@pytest.mark.parametrize("minutes", [-90, 90])
def test_a_form_plans_a_downtime_for_the_next_time_that_it_is_so_late(site, monkeypatch, minutes):
    noon = time.time() // 86_400 * 86_400 + 43_200  # of a day on which both are, whenever this runs
    monkeypatch.setattr(time, "time", lambda: noon)
    wanted = noon + 60 * minutes
    at = time.strftime("%H:%M", time.gmtime(wanted))
    form = {"token": site.token(path="/robots/a"), "robot": "a", "component": "", "for": "2h"}
    assert site.post("/-/downtime", form | {"from": at, "comment": "x"}).status == 303
    assert site.done[0][2] == pytest.approx(wanted + (86_400 if minutes < 0 else 0), abs=0.01)


@pytest.mark.parametrize("at", ["24:00", "9:00", "22:60", "22:00:01", "tonight", "22:00\n"])
def test_what_is_no_time_of_day_plans_nothing(site, at):
    form = {"token": site.token(path="/robots/a"), "robot": "a", "component": "", "for": "2h"}
    answer = site.post("/-/downtime", form | {"from": at, "comment": "x"})
    assert (answer.status, site.done) == (400, [])
    assert "is no time of day such as 22:00" in answer.text


def test_a_downtime_that_lies_ahead_is_shown_and_can_be_cancelled(serve, tmp_path):
    ahead = downtime("Motor 1") | {"from": 68_400.0}
    known = robot("a", component("Motor 1", "OK"), downtimes_ahead=[ahead])
    page = Site(serve, tmp_path, fleet_snapshot=lambda: fleet(known)).page("/robots/a").text

    text = "Motor 1: downtime from 19:00 UTC until 20:00 UTC (ann: new gears)"
    assert f"<span class=mark>{text}</span>" in page
    assert "Cancel the downtime of Motor 1 from 19:00:00 UTC until 20:00:00 UTC" in page
    assert re.search(r"From \(UTC, empty for now: \d\d:\d\d\)", page)  # as one is written there


@pytest.mark.parametrize("name", ["a\tb", "a\r\nb", "\x1b[31m", "a\u202eb", "50%25", "<Motor> 1"])
def test_a_component_of_any_name_can_be_chosen_as_the_page_offers_it(serve, tmp_path, name):
    known = robot("a", component(name, "ERROR"), problems=[broken(name, fault=FAULT)])
    site = Site(serve, tmp_path, fleet_snapshot=lambda: fleet(known))
    page = site.page("/robots/a").text
    [offered] = re.findall(r'<option value="([^"]+)">', page)
    form = {"token": site.token(path="/robots/a"), "robot": "a", "component": unescape(offered)}
    form |= {"from": "", "for": "2h", "comment": "new gears"}
    answer = site.post("/-/downtime", form)
    assert answer.status == 303
    assert site.done[0][:2] == ("a", name)


def test_a_form_cancels_the_downtime_that_its_page_shows(site):
    page = site.page("/robots/a").text
    assert page.count('action="../-/cancel-downtime"') == 2
    [until] = re.findall(
        r'value="%3CMotor%3E%201"><input type=hidden name=until value="(.+)"', page
    )
    form = {"token": site.token(), "robot": "a", "component": "<Motor> 1", "until": until}
    answer = site.post("/-/cancel-downtime", form | {"comment": "done"})
    assert (answer.status, answer.headers["Location"]) == (303, "../robots/a?done=cancelled")
    assert site.done == [("a", "<Motor> 1", 72_000.25, Person("ann", "done", "127.0.0.1"))]
    shown = site.page("/robots/a?done=cancelled").text
    assert "<p role=status class=done>The downtime is cancelled." in shown


FORMS = {
    "acknowledge": {"fault": FAULT},
    "downtime": {"robot": "a", "component": "", "from": "", "for": "2h"},
    "cancel-downtime": {"robot": "a", "component": "", "until": "72000.000"},
}


@pytest.mark.parametrize("name", FORMS)
def test_every_form_follows_the_same_rules(site, serve, tmp_path, name):
    path, form = f"/-/{name}", FORMS[name] | {"token": site.token(), "comment": "x"}
    for wrong in ({"token": ""}, {"comment": " \n"}, {"comment": "x" * 201}, {"more": "x"}):
        assert site.post(path, form | wrong).status in {400, 403}
    for headers in ({"Sec_Fetch_Site": "cross-site"}, {"Origin": "http://evil.example"}):
        assert site.post(path, form, **headers).status == 403
    assert site.post(path, form, "bob").status == 403  # the token is ann's
    assert site.post(path, form, Authorization="").status == 401
    for method in ("GET", "HEAD", "PUT", "DELETE"):
        got = ask(site.server, f"{path}?{urlencode(form)}", method, Authorization=login("ann"))
        assert got.status == 405
    off = Site(serve, tmp_path, actions=False)
    assert off.post(path, form).status == 403
    assert site.done == off.done == []
    assert site.post(path, form | {"comment": "x" * 200}).status == 303  # but for that
    for page in (f"/faults/{FAULT}", "/robots/a"):
        assert "<form" not in off.page(page).text
        assert "<form" in site.page(page).text


@pytest.mark.parametrize("until", ["", "nan", "inf", "-1", "1e9", "\u0661", "1" * 30, "x"])
def test_a_downtime_is_cancelled_by_a_plain_number_only(site, until):
    form = FORMS["cancel-downtime"] | {"token": site.token(), "comment": "x", "until": until}
    assert (site.post("/-/cancel-downtime", form).status, site.done) == (400, [])


def test_a_token_is_of_one_user_and_of_this_process(site, serve, tmp_path):
    other = Site(serve, tmp_path)
    tokens = {"", "0" * 64, "é", site.token("bob"), other.token("ann")}
    for token in tokens:
        answer = site.acknowledge(form={"token": token})
        assert (answer.status, "load it again" in answer.text) == (403, True)
    assert site.done == []
    assert site.token("ann") == site.token("ann", "/robots/a") != site.token("bob")


@pytest.mark.parametrize(
    "headers",
    [
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Sec_Fetch_Site": "none"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://[evil"},
        {"Referer": "http://evil.example/page"},
    ],
)
def test_a_form_of_another_site_is_not_followed_even_with_the_token(site, headers):
    assert site.acknowledge(**headers).status == 403
    assert site.done == []


def test_a_page_under_a_domain_name_may_act_because_the_login_is_of_that_name(site):
    answer = site.acknowledge(Host="robots.example.org", Origin="https://robots.example.org")
    assert answer.status == 303
    assert site.acknowledge(Host="robots.example.org", Origin="https://evil.org").status == 403


def test_a_large_form_is_rejected_before_it_is_read(site):
    assert site.acknowledge(form={"comment": "x" * MAX_FORM}).status == 413
    host, _, port = site.server.addresses[0].rpartition(":")
    with closing(http.client.HTTPConnection(host, int(port), timeout=20)) as client:
        client.putrequest("POST", "/-/acknowledge")
        client.putheader("Authorization", login("ann"))
        client.putheader("Content-Type", "application/x-www-form-urlencoded")
        client.putheader("Content-Length", str(10**12))
        client.endheaders(b"x" * (2 * MAX_FORM))
        assert client.getresponse().status == 413
    assert site.done == []


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 403),
        (b"token=a&token=a", 400),
        (b"&&&", 400),
        ("token=é".encode(), 400),
        (b"token=%ff", 400),
        (b"a=1&" * 20, 400),
        (b"token=a&fault=b&comment=c", 403),
    ],
)
def test_what_is_no_form_is_rejected(site, body, status):
    assert site.post("/-/acknowledge", body).status == status
    assert site.post("/-/acknowledge", body, Content_Type="application/json").status == 415
    assert site.post("/-/acknowledge", body, Content_Type="text/plain").status == 415
    assert site.done == []


def test_what_cannot_be_done_says_why_and_is_logged(serve, tmp_path, caplog):
    def over(*_given):
        raise LookupError("it has <ended>")

    def away(*_given):
        raise ConnectionError("Alertmanager does not answer")

    ended = Site(serve, tmp_path, acknowledge=over)
    with caplog.at_level(logging.WARNING):
        answer = ended.acknowledge()
    assert answer.status == 409
    assert "It has &lt;ended&gt;." in answer.text
    assert "form of ann from 127.0.0.1: 409" in caplog.text
    assert Site(serve, tmp_path, acknowledge=away).acknowledge().status == 502


def test_forms_need_users_to_log_in(serve):
    with pytest.raises(WebConfigError, match="needs basic_auth_users"):
        serve(actions=True)


def test_what_is_acknowledged_has_no_form_for_it_and_names_are_escaped(serve, tmp_path):
    evil = "\"'><script>alert(1)</script>"
    taken = {"author": "bob", "comment": "", "at": 1.0, "until": 2.0}
    known = robot(
        evil, component(evil, "ERROR"), problems=[broken(evil, fault=FAULT, acknowledged=taken)]
    )
    site = Site(serve, tmp_path, fleet_snapshot=lambda: fleet(known))
    text = site.page(f"/faults/{FAULT}").text
    assert 'action="../-/acknowledge"' not in text
    assert 'action="../-/downtime"' in text
    assert "<script>alert" not in text
