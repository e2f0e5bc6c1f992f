"""The mail server stores each mail as it was sent."""

from __future__ import annotations

import smtplib
from email.message import EmailMessage

import pytest

from testbed.mail import Inbox, MailServer


@pytest.fixture
def server(free_port):
    inbox = Inbox()
    server = MailServer(f"127.0.0.1:{free_port()}", inbox)
    server.start()
    yield server, inbox
    server.stop()


def test_a_mail_is_stored_with_its_text_and_thread(server):
    server, inbox = server
    message = EmailMessage()
    message["Subject"] = "** PROBLEM ** Wärme"
    message["References"] = "<fault-1@fleet>"
    message.set_content("the motor is hot\n")
    message.add_alternative("<p>the motor is hot</p>", subtype="html")

    with smtplib.SMTP(*server.address.split(":")) as client:
        client.send_message(message, "exporter@robots", ["operator@robots", "second@robots"])

    (mail,) = inbox.mails()
    assert mail.subject == "** PROBLEM ** Wärme"
    assert mail.text == "the motor is hot\n"
    assert mail.thread == "<fault-1@fleet>"
    assert mail.sender == "exporter@robots"
    assert mail.recipients == ("operator@robots", "second@robots")


def test_a_server_that_was_not_started_can_be_stopped(free_port):
    MailServer(f"127.0.0.1:{free_port()}", Inbox()).stop()
