"""An SMTP server on 127.0.0.1 that stores what it receives and delivers nothing further."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from email import message_from_bytes, policy
from email.message import EmailMessage

from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, Envelope, Session


@dataclass(frozen=True)
class Mail:
    """A received email."""

    received: float  # Unix time
    sender: str
    recipients: tuple[str, ...]
    subject: str
    text: str  # the plain text part, or the HTML source where there is none
    thread: str  # the Message-ID that it answers, or its own
    html: str = ""  # the HTML part, where there is one
    files: Mapping[str, bytes] = field(default_factory=dict)  # what is attached, by name


def _read(envelope: Envelope) -> Mail:
    message = message_from_bytes(envelope.original_content or b"", policy=policy.default)
    if not isinstance(message, EmailMessage):  # what policy.default makes is one
        raise TypeError(f"not an email: {type(message)}")
    body, html = message.get_body(("plain", "html")), message.get_body(("html",))
    references = str(message["References"] or message["In-Reply-To"] or message["Message-ID"] or "")
    return Mail(
        received=time.time(),
        sender=envelope.mail_from or "",
        recipients=tuple(envelope.rcpt_tos),
        subject=str(message["Subject"] or ""),
        text=body.get_content().replace("\r\n", "\n") if body else "",
        thread=references.split(maxsplit=1)[0] if references else "",
        html=html.get_content().replace("\r\n", "\n") if html else "",
        files={
            each.get_filename() or "": each.get_content() for each in message.iter_attachments()
        },
    )


class Inbox:
    """The received mails, oldest first; may be read from any thread."""

    def __init__(self) -> None:
        self._mails: list[Mail] = []
        self._lock = threading.Lock()

    def mails(self) -> list[Mail]:
        """Return all mails received until now."""
        with self._lock:
            return list(self._mails)

    def subjects(self, to: str = "") -> list[str]:
        """Return the subjects of all mails received until now, or of those to one address."""
        return [mail.subject for mail in self.mails() if not to or to in mail.recipients]

    async def handle_DATA(self, _server: SMTP, _session: Session, envelope: Envelope) -> str:  # noqa: N802 - aiosmtpd calls it by this name
        """Store a mail (aiosmtpd's hook)."""
        mail = _read(envelope)
        with self._lock:
            self._mails.append(mail)
        return "250 OK"


class MailServer:
    """An SMTP server on 127.0.0.1 in a thread of this process."""

    def __init__(self, address: str, inbox: Inbox) -> None:
        self.address = address
        self._inbox = inbox
        self._controller: Controller | None = None

    def start(self) -> None:
        """Start listening; returns when it does.

        Raises:
            OSError: The port is taken.
        """
        host, port = self.address.split(":")
        self._controller = Controller(self._inbox, hostname=host, port=int(port))
        self._controller.start()

    def stop(self) -> None:
        """Stop listening; no error if it was never started."""
        if self._controller:
            self._controller.stop(no_assert=True)
            self._controller = None
