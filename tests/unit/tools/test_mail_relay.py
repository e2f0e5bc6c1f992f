"""Mails go on to the mail server whatever happens, with the capsules of their faults attached."""

from __future__ import annotations

import smtplib
from contextlib import contextmanager
from email import message_from_bytes, policy
from email.message import EmailMessage

import click
import pytest
from aiosmtpd.controller import Controller

from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_tools.address import Address
from ros_diagnostics_tools.commands.mail_relay import Size
from ros_diagnostics_tools.mail_relay import FAULTS, Relay, Smarthost, attached, from_exporter
from ros_diagnostics_tools.main import main

FIRST, SECOND = "0123456789ab", "ba9876543210"
CAPSULES = {FIRST: b"\x89MCAP0\r\n" + bytes(range(256)) * 40, SECOND: b"\x89MCAP0\r\nsecond"}
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

    async def handle_RCPT(self, _server, _session, envelope, address, _options) -> str:  # noqa: N802
        if "rcpt" not in self.rejects:
            envelope.rcpt_tos.append(address)
        return self.rejects.get("rcpt", "250 OK")

    async def handle_DATA(self, _server, _session, envelope) -> str:  # noqa: N802
        if "data" not in self.rejects:
            self.mails.append((envelope.mail_from, envelope.rcpt_tos, envelope.original_content))
        return self.rejects.get("data", "250 OK")


@contextmanager
def listening(handler, port: int):
    """A client of ``handler`` at this port."""
    controller = Controller(handler, hostname="127.0.0.1", port=port, ready_timeout=60)
    controller.start()
    try:
        yield lambda: smtplib.SMTP("127.0.0.1", port, timeout=60)
    finally:
        controller.stop(no_assert=True)


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
    relay = Relay(Smarthost("127.0.0.1", server.port), CAPSULES.get, LIMIT)
    with listening(relay, free_port()) as connect:

        def sent(content: bytes) -> None:
            with connect() as smtp:
                smtp.sendmail("robots@example.org", ["ann@example.org", "bob@example.org"], content)

        yield sent


def test_the_capsule_is_attached_and_the_rest_is_as_it_was(server, send):
    send(mail())
    [(sender, recipients, content)] = server.mails
    assert (sender, recipients) == ("robots@example.org", ["ann@example.org", "bob@example.org"])
    message, files = read(content)
    assert files == {f"{FIRST}.mcap": CAPSULES[FIRST]}
    original, _none = read(mail())
    for kind in ("plain", "html"):
        assert message.get_body((kind,)).get_content() == original.get_body((kind,)).get_content()
    for name in ("Subject", "From", "To", "References"):
        assert message[name] == original[name]


@pytest.mark.parametrize("faults", ["", "ffffffffffff", "no id", "../../../etc"])
def test_a_mail_without_a_capsule_is_the_same_to_the_byte(server, send, faults):
    sent = mail(faults, ".a line that begins with a dot\n.\n")
    send(sent)
    assert [content for _from, _to, content in server.mails] == [sent]


def test_capsules_are_attached_as_long_as_they_fit_together():
    both = mail(f"{FIRST} {SECOND} {FIRST}")
    assert attached(both, CAPSULES.get, LIMIT)[1] == [FIRST, SECOND]
    assert attached(both, CAPSULES.get, len(CAPSULES[FIRST]))[1] == [FIRST]
    assert attached(both, CAPSULES.get, len(CAPSULES[FIRST]) - 1)[1] == [SECOND]
    assert attached(both, CAPSULES.get, 1) == (both, [])


class Exporter:
    """Answers with a capsule, or not at all."""

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
    path = f"/api/v1/faults/{FIRST}/capsule.mcap?so_far=true"
    assert exporter.asked == [(path, 500)]
    silent = from_exporter(Exporter(UnreachableError("timed out")), 500)
    sent = mail()
    assert attached(sent, silent, 500) == (sent, [])
    assert f"fault {FIRST}: its capsule is not attached: timed out" in caplog.text


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
    relay = Relay(Smarthost("127.0.0.1", free_port()), CAPSULES.get, LIMIT)
    with listening(relay, free_port()) as connect, connect() as smtp:
        smtp.ehlo()
        smtp.mail("robots@example.org")
        code, text = smtp.rcpt("ann@example.org")
    assert code == 451
    assert b"refused" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--attach-below", "1 TB"], "not a size such as 100kB"),
        (["--listen", "2525"], "not an address such as localhost:25"),
        (["--smarthost-user", "ann"], "need each other"),
    ],
)
def test_wrong_arguments_are_named(arguments, said, capsys):
    assert main(["mail-relay", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_sizes_and_addresses_of_the_flags():
    sizes = [Size().convert(each, None, None) for each in ("100kB", "2 MB")]
    assert sizes == [100_000, 2_000_000]
    addresses = [Address().convert(each, None, None) for each in ("a:25", "[::1]:2525")]
    assert addresses == [("a", 25), ("::1", 2525)]


@pytest.mark.parametrize(
    ("kind", "text"),
    [(Size(), "2"), (Size(), "2GB"), (Address(), "a"), (Address(), ":25"), (Address(), "a:0"),
     (Address(), "a:65536")],
)  # fmt: skip
def test_a_size_or_an_address_that_is_none_is_wrong_usage(kind, text):
    with pytest.raises(click.BadParameter):
        kind.convert(text, None, None)
