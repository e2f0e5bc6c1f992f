"""Mails go on to the mail server whatever happens, with the recordings of their faults attached."""

import logging
import smtplib
import ssl
from contextlib import ExitStack, closing, contextmanager
from email import message_from_bytes, policy
from email.message import EmailMessage

import pytest
import trustme
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import AuthResult

from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_tools import mail_server
from ros_diagnostics_tools.flag_types import Address, Size
from ros_diagnostics_tools.mail_relay import FAULTS, Relay, Smarthost, attached, from_exporter
from ros_diagnostics_tools.mail_server import Server
from testbed.polling import until

FIRST, SECOND = "0123456789ab", "ba9876543210"
RECORDINGS = {FIRST: b"\x89MCAP0\r\n" + bytes(range(256)) * 40, SECOND: b"\x89MCAP0\r\nsecond"}
LIMIT = 100_000


def mail(faults=FIRST, text="Motor is CRITICAL\n") -> bytes:
    """A mail as Alertmanager writes it."""
    message = EmailMessage(policy=policy.SMTP)
    message["Subject"] = "** PROBLEM ** f/r1 Motör is CRITICAL"
    message["From"], message["To"] = "robots@example.org", "ann@example.org"
    message["References"] = f"<f.r1.{'x' * 200}@ros-diagnostics>"
    message[FAULTS] = faults
    message.set_content(text)
    message.add_alternative(f"<p>{text}</p>", subtype="html")
    return message.as_bytes()


def read(content: bytes):
    """(the message, its attachments by name)."""
    message = message_from_bytes(content, policy=policy.default)
    files = {each.get_filename(): each.get_content() for each in message.iter_attachments()}
    return message, files


class MailServer:
    """A mail server that keeps what it gets, or rejects it at one step."""

    def __init__(self) -> None:
        self.mails: list[tuple[str, list[str], bytes]] = []
        self.rejects: dict[str, str] = {}
        self.connections = self.ended = 0

    async def handle_EHLO(self, _server, session, _envelope, name, answers):  # noqa: N802
        session.host_name = name
        self.connections += 1
        return answers

    async def handle_QUIT(self, _server, _session, _envelope) -> str:  # noqa: N802
        self.ended += 1
        return "221 Bye"

    async def handle_RCPT(self, _server, _session, envelope, address, _options) -> str:  # noqa: N802
        if "rcpt" not in self.rejects:
            envelope.rcpt_tos.append(address)
        return self.rejects.get("rcpt", "250 OK")

    async def handle_DATA(self, _server, _session, envelope) -> str:  # noqa: N802
        if "data" not in self.rejects:
            self.mails.append((envelope.mail_from, envelope.rcpt_tos, envelope.original_content))
        return self.rejects.get("data", "250 OK")


@contextmanager
def running(controller):
    """A client of what listens."""
    controller.start()
    try:
        yield lambda: smtplib.SMTP("127.0.0.1", controller.port, timeout=60)
    finally:
        controller.stop(no_assert=True)


def listening(handler, port: int, **more):
    """A client of ``handler`` at this port."""
    address = {"hostname": "127.0.0.1", "port": port, "ready_timeout": 60}
    return running(Controller(handler, **address, **more))


@pytest.fixture
def server(free_port):
    """A mail server, listening; ``server.port``."""
    made = MailServer()
    made.port = free_port()
    with listening(made, made.port):
        yield made


@pytest.fixture
def send(free_port, server):
    """A function (mail): hands it to a relay before the server."""
    relay = Relay(Smarthost("127.0.0.1", server.port), RECORDINGS.get, LIMIT)
    with listening(relay, free_port()) as connect:

        def sent(content: bytes) -> None:
            with connect() as smtp:
                smtp.sendmail("robots@example.org", ["ann@example.org", "bob@example.org"], content)

        yield sent


def test_the_recording_is_attached_and_the_rest_is_as_it_was(server, send):
    send(mail())
    [(sender, recipients, content)] = server.mails
    assert (sender, recipients) == ("robots@example.org", ["ann@example.org", "bob@example.org"])
    message, files = read(content)
    assert files == {f"{FIRST}.mcap": RECORDINGS[FIRST]}
    original, _none = read(mail())
    for kind in ("plain", "html"):
        assert message.get_body((kind,)).get_content() == original.get_body((kind,)).get_content()
    for name in ("Subject", "From", "To", "References"):
        assert message[name] == original[name]


@pytest.mark.parametrize("faults", ["", "ffffffffffff", "no id", "../../../etc"])
def test_a_mail_without_a_recording_is_the_same_to_the_byte(server, send, faults):
    sent = mail(faults, ".a line that begins with a dot\n.\n")
    send(sent)
    assert [content for _from, _to, content in server.mails] == [sent]


def test_recordings_are_attached_as_long_as_they_fit_together():
    both = mail(f"{FIRST} {SECOND} {FIRST}")
    assert attached(both, RECORDINGS.get, LIMIT)[1] == [FIRST, SECOND]
    assert attached(both, RECORDINGS.get, len(RECORDINGS[FIRST]))[1] == [FIRST]
    assert attached(both, RECORDINGS.get, len(RECORDINGS[FIRST]) - 1)[1] == [SECOND]
    assert attached(both, RECORDINGS.get, 1) == (both, [])


class Exporter:
    """Answers with a recording, or not at all."""

    def __init__(self, answer) -> None:
        self.answer, self.asked = answer, []

    def download(self, path, *, limit):
        self.asked.append((path, limit))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def test_the_exporter_is_asked_for_the_fault_that_lasts_and_its_silence_stops_no_mail(caplog):
    exporter = Exporter(b"mcap")
    assert from_exporter(exporter, 500)(FIRST) == b"mcap"
    path = f"/api/v1/faults/{FIRST}/recording.mcap?so_far=true"
    assert exporter.asked == [(path, 500)]
    silent = from_exporter(Exporter(UnreachableError("timed out")), 500)
    sent = mail()
    assert attached(sent, silent, 500) == (sent, [])
    assert f"fault {FIRST}: its recording is not attached: timed out" in caplog.text


@pytest.mark.parametrize("step", ["rcpt", "data"])
@pytest.mark.parametrize("answer", ["451 try again", "554 no thanks"])
def test_what_the_mail_server_rejects_is_rejected_in_its_words(server, send, step, answer):
    server.rejects[step] = answer
    with pytest.raises((smtplib.SMTPRecipientsRefused, smtplib.SMTPDataError)) as caught:
        send(mail())
    refused = getattr(caught.value, "recipients", {})
    code, text = refused.get("ann@example.org") or caught.value.args
    assert f"{code} {text.decode()}" == answer
    assert server.mails == []


def test_a_mail_server_that_does_not_answer_is_tried_again_by_alertmanager(free_port):
    relay = Relay(Smarthost("127.0.0.1", free_port()), RECORDINGS.get, LIMIT)
    with listening(relay, free_port()) as connect, connect() as smtp:
        smtp.ehlo()
        smtp.mail("robots@example.org")
        code, text = smtp.rcpt("ann@example.org")
    assert code == 451
    assert b"refused" in text


@pytest.fixture
def authority(tmp_path):
    """An authority's file, and a function (name): a server's side of its certificate."""
    made = trustme.CA()
    made.cert_pem.write_to_path(tmp_path / "ca.pem")

    def context(name: str) -> ssl.SSLContext:
        found = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        made.issue_cert(name).configure_cert(found)
        return found

    return tmp_path / "ca.pem", context


@pytest.mark.parametrize(
    ("name", "trusts", "said"),
    [
        ("localhost", True, ""),
        ("localhost", False, "certificate verify failed"),
        ("mail.example.org", True, "certificate verify failed"),
    ],
    ids=["the right one", "another authority", "another name"],
)
def test_only_the_mail_server_of_the_certificate_gets_password_and_mail(
    free_port, authority, name, trusts, said
):
    ca_file, context = authority
    password = ca_file.with_name("password")
    password.write_text("geheim\n")
    logins: list[bytes] = []

    def authenticate(_server, _session, _envelope, _mechanism, data) -> AuthResult:
        logins.append(data.password)
        return AuthResult(success=True)

    made = MailServer()
    tls = {"tls_context": context(name), "authenticator": authenticate}
    port = free_port()
    with listening(made, port, **tls):
        trusted = ca_file if trusts else None
        smarthost = Smarthost("localhost", port, True, "fleet", password, trusted)
        relay = Relay(smarthost, RECORDINGS.get, LIMIT)
        with listening(relay, free_port()) as connect, connect() as smtp:
            smtp.ehlo()
            smtp.mail("robots@example.org")
            code, text = smtp.rcpt("ann@example.org")

    assert (code, said in text.decode()) == (451 if said else 250, True)
    assert logins == ([] if said else [b"geheim"])


def test_a_mail_has_one_connection_to_the_mail_server_for_all_recipients(server, send):
    send(mail())
    assert (len(server.mails), server.connections) == (1, 1)


@pytest.fixture
def serving(free_port, server):
    """A function: a client of a relay before the server, as the command starts it."""
    relay = Relay(Smarthost("127.0.0.1", server.port), RECORDINGS.get, LIMIT)
    return lambda: running(Server(relay, "127.0.0.1", free_port()))


def test_a_mail_that_is_given_up_leaves_no_connection(serving, server):
    with serving() as connect:
        for _ in range(2):
            smtp = connect()
            smtp.ehlo()
            smtp.mail("robots@example.org")
            smtp.rcpt("ann@example.org")
            smtp.close()
        until(lambda: server.ended == 2, "the end of both connections")


def test_a_mail_of_more_than_two_megabytes_is_rejected(serving, server):
    with serving() as connect, connect() as smtp:
        for size, code in ((1_900_000, 250), (2_100_000, 552)):
            smtp.ehlo()
            smtp.mail("robots@example.org")
            smtp.rcpt("ann@example.org")
            smtp.putcmd("data")
            smtp.getreply()
            smtp.send(b"x" * 70 + b"\r\n" + (b"y" * 70 + b"\r\n") * (size // 72) + b".\r\n")
            assert smtp.getreply()[0] == code
            smtp.rset()
    assert len(server.mails) == 1


def test_idle_connections_lock_nobody_out(serving, server):
    with serving() as connect, ExitStack() as stack:
        idle = [stack.enter_context(closing(connect())) for _ in range(mail_server.CONNECTIONS + 9)]
        with connect() as smtp:
            smtp.sendmail("robots@example.org", ["ann@example.org"], mail())
        with pytest.raises(smtplib.SMTPServerDisconnected):
            idle[0].ehlo()
        idle[-1].ehlo()
    assert len(server.mails) == 1


@pytest.mark.parametrize("limit", ["IDLE", "LIFETIME"])
def test_a_connection_ends_in_time(serving, monkeypatch, limit):
    monkeypatch.setattr(mail_server, limit, 0.5)
    with serving() as connect, closing(connect()) as smtp:
        assert smtp.sock.recv(100) == b""


def test_what_clients_write_is_not_logged(serving, caplog):
    caplog.set_level(logging.INFO)
    with serving() as connect, connect() as smtp:
        smtp.sendmail("robots@example.org", ["ann@example.org"], mail())
    names = [each.name for each in caplog.records if each.name.startswith("mail.")]
    assert (names, "mail forwarded" in caplog.text) == ([], True)


@pytest.mark.parametrize(
    ("host", "starttls", "hidden"),
    [
        ("localhost", False, True),
        ("127.0.0.2", False, True),
        ("::1", False, True),
        ("mail.example.org", False, False),
        ("10.0.0.1", False, False),
        ("mail.example.org", True, True),
    ],
)
def test_a_login_in_clear_is_for_this_machine_only(host, starttls, hidden):
    assert Smarthost(host, 25, starttls).hides_password is hidden


LOGIN = ["--smarthost-user", "ann", "--smarthost-password-file", "password"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([*LOGIN, "--smarthost", "mail.example.org:25"], "needs --starttls"),
        (["--listen", "2525"], "not an address such as localhost:25"),
        (["--smarthost-user", "ann"], "or neither"),
    ],
)
def test_wrong_arguments_are_named(arguments, said, run):
    assert said in run("mail-relay", *arguments, code=2).err


def test_sizes_and_addresses_of_the_flags():
    assert [*map(Size().read, ("100kB", "2 MB"))] == [100_000, 2_000_000]
    assert [*map(Address().read, ("a:25", "[::1]:2525"))] == [("a", 25), ("::1", 2525)]


@pytest.mark.parametrize("size", ["2", "2GB", "1 TB"])
def test_a_size_that_is_none_is_wrong_usage(size, run):
    said = run("mail-relay", "--attach-below", size, code=2).err
    assert "not a size such as 100kB" in said
