import asyncio
import base64
import threading

import bcrypt
import pytest

from ros_diagnostics_exporter import rejected_logins
from ros_diagnostics_exporter.web import middleware
from ros_diagnostics_exporter.web.middleware import Buckets, Logins
from ros_diagnostics_exporter.web.server import Server
from support.web_server import FakeBackend, ask, reloaded, wait_until

PASSWORD = "häslo: with colon"
RECORDING = "/api/v1/faults/0123456789ab/recording.mcap?so_far=true"


def hashed(password: str) -> str:
    return bcrypt.hashpw(password.encode(), bcrypt.gensalt(rounds=4)).decode()


def basic(user: str, password: str) -> str:
    return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode()


@pytest.fixture
def web_config(tmp_path):
    path = tmp_path / "web.yml"
    path.write_text(f"basic_auth_users:\n  alice: {hashed(PASSWORD)}\n")
    return path


@pytest.fixture(scope="module")
def protected(tmp_path_factory):
    """A server that requires alice's password."""
    path = tmp_path_factory.mktemp("protected") / "web.yml"
    path.write_text(f"basic_auth_users: {{alice: {hashed(PASSWORD)}}}")
    server = Server(FakeBackend(), listen=["127.0.0.1:0"], web_config=path)
    server.start()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rejected_logins, "ALLOWED", 1_000)  # those of all tests
        yield server
    server.stop()


@pytest.mark.parametrize(
    "header",
    [
        "",
        basic("alice", "wrong"),
        basic("bob", PASSWORD),
        basic("alice", ""),
        basic("", ""),
        basic("alice", PASSWORD + "\0"),
        basic("alice", PASSWORD).replace("Basic", "Bearer"),
        "Basic",
        "Basic ###",
        basic("alice", PASSWORD).replace("Basic ", "Basic #"),
        "Basic " + base64.b64encode(b"alice").decode(),
    ],
)
def test_every_path_needs_a_valid_login(protected, header):
    for path in ("/metrics", "/", "/-/healthy", "/no/such/path", RECORDING, "/-/acknowledge"):
        answer = ask(protected, path, Authorization=header)
        assert answer.status == 401
        assert answer.headers["WWW-Authenticate"].startswith("Basic realm=")
        assert answer.body == b"Unauthorized\n"


def test_a_valid_login_is_computed_once(serve, web_config, monkeypatch):
    computed = []
    real = bcrypt.checkpw

    def count(*arguments):
        computed.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(middleware.bcrypt, "checkpw", count)
    server = serve(web_config=web_config)
    for _ in range(3):
        assert ask(server, "/metrics", Authorization=basic("alice", PASSWORD)).status == 200
    assert len(computed) == 1
    for _ in range(2):
        assert ask(server, "/metrics", Authorization=basic("alice", "wrong")).status == 401
    assert len(computed) == 3


def test_of_too_many_valid_logins_the_first_is_forgotten(monkeypatch):
    monkeypatch.setattr(middleware, "CACHED_LOGINS", 2)
    users = {name: hashed(name) for name in "abc"}
    logins = Logins()

    async def known() -> list[bool]:
        for name in users:
            assert await logins.allows(users, basic(name, name))
        return [await logins.allows(users, basic(each, each), only_known=True) for each in users]

    try:
        assert asyncio.run(known()) == [False, True, True]
    finally:
        logins.close()


def test_an_unknown_user_costs_as_much_as_a_known_one():
    known = {"alice": bcrypt.hashpw(b"x", bcrypt.gensalt(rounds=5)).decode()}
    assert middleware._dummy_hash(known)[:7] == "$2b$05$"
    assert len(middleware._dummy_hash({})) == len(known["alice"])
    assert bcrypt.checkpw(b"anything", middleware._dummy_hash(known).encode()) is False


def test_an_unknown_user_is_rejected_whatever_the_comparison_says(protected, monkeypatch):
    monkeypatch.setattr(middleware.bcrypt, "checkpw", lambda *_: True)
    assert ask(protected, "/metrics", Authorization=basic("carol", "x")).status == 401
    assert ask(protected, "/metrics", Authorization=basic("alice", "x")).status == 200


def test_a_password_is_compared_up_to_72_bytes(serve, tmp_path):
    path = tmp_path / "web.yml"
    path.write_text(f"basic_auth_users: {{alice: {hashed('x' * 72)}}}")
    server = serve(web_config=path)
    assert ask(server, "/", Authorization=basic("alice", "x" * 5000)).status == 200
    assert ask(server, "/", Authorization=basic("alice", "x" * 72)).status == 200
    assert ask(server, "/", Authorization=basic("alice", "x" * 71)).status == 401


@pytest.mark.usefixtures("seldom")
def test_a_changed_password_applies_soon_and_an_invalid_file_changes_nothing(
    serve, web_config, caplog
):
    server = serve(web_config=web_config)
    old, new = basic("alice", PASSWORD), basic("alice", "fresh")
    assert ask(server, "/", Authorization=old).status == 200

    web_config.write_text(f"basic_auth_users: {{alice: {hashed('fresh')}}}")
    assert ask(reloaded(server), "/", Authorization=old).status == 401
    assert ask(server, "/", Authorization=new).status == 200

    web_config.write_text("basic_auth_users: {alice: plain text}")
    assert ask(reloaded(server), "/", Authorization=new).status == 200
    assert ask(server, "/", Authorization=old).status == 401
    reloaded(server)  # it has not changed since
    assert caplog.text.count("is not a bcrypt hash") == 1

    web_config.write_text("")  # as while it is being written
    assert ask(reloaded(server), "/").status == 401
    assert "basic_auth_users cannot be removed" in caplog.text

    web_config.unlink()
    assert ask(reloaded(server), "/").status == 401


def test_a_flood_of_invalid_logins_is_limited_and_does_not_delay_a_valid_one(
    serve, web_config, monkeypatch
):
    release, entered, checks = threading.Event(), threading.Event(), []

    def slow(password, _hash):
        if password == b"wrong":
            checks.append(password)
            entered.set()
            assert release.wait(20)
            return False
        return True

    server = serve(web_config=web_config)
    assert ask(server, "/metrics", Authorization=basic("alice", PASSWORD)).status == 200
    monkeypatch.setattr(middleware.bcrypt, "checkpw", slow)
    statuses = []
    flood = [
        threading.Thread(
            target=lambda: statuses.append(
                ask(server, "/", Authorization=basic("alice", "wrong")).status
            )
        )
        for _ in range(30)
    ]
    for each in flood:
        each.start()
    assert entered.wait(20)
    wait_until(lambda: len(statuses) == 10)
    assert len(checks) == 1
    assert ask(server, "/metrics", Authorization=basic("alice", PASSWORD)).status == 200
    release.set()
    for each in flood:
        each.join(20)
    assert sorted(statuses) == [401] * 20 + [503] * 10


def test_configured_headers_replace_the_defaults(serve, tmp_path):
    path = tmp_path / "web.yml"
    path.write_text(
        "http_server_config: {headers: {X-Frame-Options: sameorigin,"
        " Strict-Transport-Security: max-age=1}}"
    )
    headers = ask(serve(web_config=path), "/metrics").headers
    assert headers["X-Frame-Options"] == "sameorigin"
    assert headers["Strict-Transport-Security"] == "max-age=1"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Server" not in headers


def test_the_rate_limit_is_per_client(serve, tmp_path):
    path = tmp_path / "web.yml"
    path.write_text(
        f"rate_limit: {{interval: 1h, burst: 2}}\nbasic_auth_users: {{alice: {hashed(PASSWORD)}}}"
    )
    server = serve(web_config=path)
    flood = [ask(server, "/metrics", source="127.0.0.2").status for _ in range(10)]
    assert flood == [401] * 2 + [429] * 8
    assert ask(server, "/metrics", Authorization=basic("alice", PASSWORD)).status == 200


def test_the_number_of_rate_limited_clients_is_limited():
    buckets = Buckets()
    for number in range(middleware.MAX_BUCKETS + 10):
        assert buckets.take(str(number), 3600.0, 1, 100.0)
    assert not buckets.take("900", 3600.0, 1, 100.0)
    assert len(buckets._buckets) == middleware.MAX_BUCKETS
    assert not buckets.take("900", 1.0, 1, 100.0)
    assert all(buckets.take("900", 0.0, 0, 100.0) for _ in range(5))


def test_a_bucket_refills_up_to_its_burst():
    buckets = Buckets()
    assert [buckets.take("a", 1.0, 2, 100.0) for _ in range(3)] == [True, True, False]
    assert [buckets.take("a", 1.0, 2, 101.0) for _ in range(2)] == [True, False]
    assert [buckets.take("a", 1.0, 2, 900.0) for _ in range(3)] == [True, True, False]


def test_after_too_many_wrong_passwords_an_address_has_a_pause(serve, web_config, monkeypatch):
    """Who has logged in before is let in: behind a proxy all have one address."""
    monkeypatch.setattr(rejected_logins, "ALLOWED", 10)
    server = serve(web_config=web_config)
    right = basic("alice", PASSWORD)
    assert ask(server, "/metrics", Authorization=right).status == 200
    for number in range(12):
        answer = ask(server, "/metrics", Authorization=basic("alice", str(number)))
        assert answer.status == (401 if number < 11 else 429)
    assert answer.headers["Retry-After"] == "60"
    assert ask(server, "/metrics", Authorization=right).status == 200
    assert ask(server, "/metrics").status == 429
