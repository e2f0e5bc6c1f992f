"""Which client loses its connection, what responses and calls may cost; each without a server."""

import asyncio
import resource
import threading
from base64 import b64encode
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.web import middleware, responses
from ros_diagnostics_exporter.web.connections import (
    MAX_CONNECTIONS,
    MIN_AFTER_ERROR,
    MIN_CONNECTIONS,
    TIMEOUTS,
    Connections,
    Phase,
    client_address,
    connection_limit,
)
from ros_diagnostics_exporter.web.middleware import Logins
from ros_diagnostics_exporter.web.responses import BusyError, ResponseLimit, Workers, in_chunks
from testbed.configuration import CHECKOUT


class Client:
    """A client's connection, as far as limits know it."""

    def __init__(self, address="a", stalled=0.0, *, login=False, pipelines=False):
        self.address, self.authenticated, self.pipelines = address, login, pipelines
        self.stalled, self.aborted, self.closed = stalled, False, False

    def stalled_for(self):
        return self.stalled

    def abort(self):
        self.aborted = True


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("10.0.0.5", "10.0.0.5"),
        ("::ffff:10.0.0.5", "10.0.0.5"),
        ("fd00:0:0:1:2:3:4:5", "fd00:0:0:1::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("a name", "a name"),
    ],
)
def test_all_addresses_of_an_ipv6_network_are_one_client(host, address):
    assert client_address(host) == address


def opened(limit, *clients):
    connections = Connections(limit)
    for each in clients:
        connections.add(each)
    return connections


@pytest.mark.parametrize(
    ("first", "others"),
    [
        (Client("b"), [Client("a", 9.0, login=True)] * 3),
        (Client("b", 5.0), [Client("a", 4.0)]),
        (Client("b", pipelines=True), [Client("a", 9.0)]),
        (Client("b", 0.5), [Client("a", 9.0), Client("b", 0.4)]),  # has more than a tenth
    ],
)
def test_the_first_to_lose_its_connection_has_no_login_or_too_many_or_makes_no_progress(
    first, others
):
    connections = opened(10, *others, first)
    connections.close_worst()
    assert first.aborted
    assert not any(each.aborted for each in others)


def test_there_are_never_more_connections_than_the_limit_and_fewer_after_an_error():
    clients = [Client(str(number), number) for number in range(12)]
    connections = opened(10, *clients)
    assert len(connections) == 10
    assert [each.stalled for each in clients if each.aborted] == [9, 10]
    connections.lower_limit()
    assert (len(connections), connections.limit) == (8, 8)
    connections.discard(clients[0])
    assert len(connections) == 7
    for _ in range(9):
        connections.lower_limit()
    assert len(connections) == connections.limit == MIN_AFTER_ERROR


def test_the_limits_are_those_of_the_page_about_security():
    page = " ".join((CHECKOUT / "SECURITY.md").read_text().split())
    to_arrive, *to_be_read = (f"{TIMEOUTS[each]:.0f} s" for each in Phase if each is not Phase.IDLE)
    assert len(set(to_be_read)) == 1
    for said in (
        f"A request has {to_arrive} to arrive, and an answer {to_be_read[0]} to be read.",
        f"if there are {MAX_CONNECTIONS} connections",
        f"Answers may take {responses.MAX_BYTES / (1 << 20):g} MiB of memory.",
    ):
        assert said in page


@pytest.mark.parametrize(
    ("files", "domains", "expected"),
    [(2_000, 1, MAX_CONNECTIONS), (180, 2, 80), (181, 2, 81), (60, 0, MIN_CONNECTIONS)],
)
def test_connections_leave_files_for_the_exporter_and_its_domains(
    monkeypatch, caplog, files, domains, expected
):
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (files, files))
    assert connection_limit(domains) == expected
    assert ("only" in caplog.text) == (expected < MAX_CONNECTIONS)
    if caplog.text:
        assert f"raise the limit to {MAX_CONNECTIONS + 60 + 20 * domains}" in caplog.text


def test_the_limit_of_open_files_is_raised_where_that_is_allowed(monkeypatch, caplog):
    monkeypatch.setattr(resource, "getrlimit", lambda _which: (100, 2_000))
    monkeypatch.setattr(resource, "setrlimit", lambda _which, _limits: None)
    assert connection_limit(0) == MAX_CONNECTIONS
    assert not caplog.text


def test_a_limit_of_open_files_that_cannot_be_raised_is_said(monkeypatch, caplog):
    def deny(*_arguments):
        raise ValueError("not allowed")

    monkeypatch.setattr(resource, "getrlimit", lambda _which: (100, 2_000))
    monkeypatch.setattr(resource, "setrlimit", deny)
    assert connection_limit(0) == 40
    assert "the limit of open files cannot be raised above 100: not allowed" in caplog.text


def test_bytes_that_nobody_reads_are_those_of_the_client_that_has_stalled(monkeypatch):
    monkeypatch.setattr(responses, "MAX_BYTES", 100)
    reads, stalls, new = Client("a"), Client("b", 0.6), Client("c")
    limit = ResponseLimit(Connections(10))
    limit.reserve(reads, 50)
    limit.reserve(stalls, 50)
    limit.reserve(new, 50)
    assert (stalls.aborted, reads.aborted) == (True, False)
    with pytest.raises(BusyError):
        limit.reserve(Client("d"), 1)
    limit.resize(reads, 49)
    limit.resize(stalls, 1_000)  # it is lost
    limit.reserve(Client("d"), 1)
    for each in (reads, new):
        limit.release(each)
    limit.reserve(Client("e"), 99)


def test_a_response_of_any_size_is_sent_alone(monkeypatch):
    monkeypatch.setattr(responses, "MAX_BYTES", 100)
    ResponseLimit(Connections(10)).reserve(Client(), 1_000)


def test_a_scrape_waits_until_another_is_read_unless_its_client_has_gone(monkeypatch):
    monkeypatch.setattr(responses, "MAX_BYTES", 100)
    monkeypatch.setattr(responses, "MAX_WAIT", 1_000.0)
    monkeypatch.setattr(responses, "STALLED_AFTER", 1_000.0)
    limit, reads, gone = ResponseLimit(Connections(10)), Client("a"), Client("b")
    gone.closed = True

    async def scrape():
        limit.reserve(reads, 100)
        with pytest.raises(BusyError):
            await asyncio.wait_for(limit.reserve_or_wait(gone, 1), 20)
        waiting = asyncio.ensure_future(limit.reserve_or_wait(Client("c"), 100))
        await asyncio.sleep(0)
        assert not waiting.done()
        limit.release(reads)
        await asyncio.wait_for(waiting, 20)

    asyncio.run(scrape())


@given(st.lists(st.binary(max_size=20)), st.integers(1, 7))
def test_chunks_are_the_same_bytes_and_not_long(pieces, size):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(responses, "CHUNK", size)
        chunks = [*in_chunks(pieces)]
    assert b"".join(chunks) == b"".join(pieces)
    assert all(len(chunk) <= size for chunk in chunks)
    assert all(chunks) or b"" in pieces
    assert sum(len(chunk) < size for chunk in chunks) <= len(pieces)


@pytest.fixture
def workers():
    made = Workers("test", threads=1, max_pending=2)
    yield made
    made.close()


def test_closing_waits_for_the_call_that_runs_and_drops_those_that_wait():
    workers, running, calls = Workers("test", threads=1, max_pending=3), threading.Event(), []

    async def close():
        first = asyncio.ensure_future(workers.run(running.wait))
        second = asyncio.ensure_future(workers.run(calls.append, 1))
        await asyncio.sleep(0)
        threading.Timer(0.05, running.set).start()
        workers.close()
        assert await first
        with pytest.raises(asyncio.CancelledError):
            await second

    asyncio.run(close())
    assert calls == []


def test_so_many_calls_may_wait_however_many_were_done_before(workers):
    running = threading.Event()

    async def ask():
        for _ in range(5):
            await workers.run(int)
        calls = [asyncio.ensure_future(workers.run(running.wait)) for _ in range(2)]
        await asyncio.sleep(0)
        for run in workers.run, partial(workers.run_shared, 1.0):
            with pytest.raises(BusyError):
                await run(int)
        running.set()
        assert await asyncio.gather(*calls) == [True, True]
        assert await workers.run(int) == 0

    asyncio.run(ask())


def test_a_result_is_shared_until_it_is_old_or_dropped(workers):
    calls = []

    async def ask():
        await workers.run_shared(0.02, calls.append, 1)
        await workers.run_shared(0.02, calls.append, 1)
        for _ in range(2_000):
            await workers.run_shared(0.02, calls.append, 1)
            if len(calls) == 2:  # it was old
                break
            await asyncio.sleep(0.005)
        await workers.run_shared(600.0, calls.append, 2)
        workers.invalidate()
        await workers.run_shared(600.0, calls.append, 2)
        await workers.run_shared(0, calls.append, 3)
        await asyncio.sleep(0)
        await workers.run_shared(0, calls.append, 3)

    asyncio.run(ask())
    assert calls == [1, 1, 2, 2, 3, 3]


def test_of_the_valid_logins_the_last_hundred_are_cached(monkeypatch):
    computed = []
    monkeypatch.setattr(middleware, "_matches", lambda *given: computed.append(given) or True)
    logins = Logins()
    users = {str(number): "$2b$04$" + "." * 53 for number in range(middleware.CACHED_LOGINS + 1)}

    async def log_in(*names):
        return [
            await logins.allows(users, "Basic " + b64encode(f"{name}:p".encode()).decode())
            for name in names
        ]

    assert asyncio.run(log_in(*users, *list(users)[1:])) == [True] * (2 * len(users) - 1)
    assert len(computed) == len(users)
    assert asyncio.run(log_in("0")) == [True]
    assert len(computed) == len(users) + 1
    logins.close()
