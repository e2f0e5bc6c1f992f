"""Hands Alertmanager's mails on to the mail server, with the recordings of their faults attached.

Alertmanager cannot attach a file. A mail names its faults in the header `FAULTS`; whatever goes
wrong with a recording, the mail is forwarded as it is. It is accepted once the mail server has it.
"""

from __future__ import annotations

import asyncio
import logging
import re
import smtplib
import ssl
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from email import message_from_bytes, policy
from email.message import EmailMessage
from ipaddress import ip_address
from pathlib import Path
from typing import Any, NamedTuple

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.texts import one_line

FAULTS = "X-ROS-Diagnostics-Faults"  # ids, in alertmanager.yml
TIMEOUT = 20.0  # seconds for each step of the mail server
_ID = re.compile(r"\b[0-9a-f]{12}\b")
_AS_IT_IS = policy.SMTP.clone(refold_source="none")

log = logging.getLogger(__name__)


class Attachment(NamedTuple):
    """What is attached."""

    fault: str
    content: bytes


@dataclass(frozen=True)
class Smarthost:
    """The mail server; with a user also the file with the password in one line.

    Its certificate has to be one of ``ca_file``, or of this machine's authorities, and have its
    name.
    """

    host: str
    port: int
    starttls: bool = False
    user: str | None = None
    password_file: Path | None = None
    ca_file: Path | None = None

    @property
    def hides_password(self) -> bool:
        """Whether nobody on the way can read a login."""
        return self.starttls or is_loopback(self.host)

    def connect(self) -> smtplib.SMTP:
        """Open a connection, and log in where there is a user.

        Raises:
            OSError, smtplib.SMTPException: it does not answer, is another one than its
                certificate says, or rejects the login.
        """
        smtp = smtplib.SMTP(self.host, self.port, timeout=TIMEOUT)
        try:
            if self.starttls:
                smtp.starttls(context=ssl.create_default_context(cafile=self.ca_file))
            if self.user is not None and self.password_file is not None:
                smtp.login(self.user, self.password_file.read_text("utf-8").rstrip("\r\n"))
        except BaseException:
            smtp.close()
            raise
        return smtp


def is_loopback(host: str) -> bool:
    """Whether a host is this machine, by its name or address."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


Fetch = Callable[[str], "bytes | None"]


def from_exporter(exporter: Client, most: int) -> Fetch:
    """What reads a fault's recording, of at most so many bytes; None where there is none."""

    def fetch(fault: str) -> bytes | None:
        path = f"/api/v1/faults/{fault}/recording.mcap?so_far=true"
        try:
            return exporter.download(path, limit=most)
        except UnreachableError as error:
            log.warning("fault %s: its recording is not attached: %s", fault, one_line(str(error)))
            return None

    return fetch


def attached(mail: bytes, fetch: Fetch, most: int) -> tuple[bytes, list[str]]:
    """A mail with the recordings of its faults, of ``most`` bytes in all, and the faults' ids.

    Without any it is the mail as it was, to the byte.
    """
    message = message_from_bytes(mail, policy=_AS_IT_IS)
    if not isinstance(message, EmailMessage):  # what the policy makes is one
        raise TypeError(f"not an email: {type(message)}")
    found = list(_recordings(dict.fromkeys(_ID.findall(str(message[FAULTS] or ""))), fetch, most))
    for each in found:
        name = f"{each.fault}.mcap"
        message.add_attachment(each.content, "application", "octet-stream", filename=name)
    return message.as_bytes() if found else mail, [each.fault for each in found]


def _recordings(faults: dict[str, None], fetch: Fetch, most: int) -> Iterator[Attachment]:
    left = most
    for fault in faults:
        content = fetch(fault) if left > 0 else None
        if content is not None and len(content) <= left:
            left -= len(content)
            yield Attachment(fault, content)


class Delivery:
    """One mail on its way: one connection to the mail server for all of its recipients."""

    def __init__(self, smarthost: Smarthost, sender: str) -> None:
        self._smarthost, self._sender = smarthost, sender
        self._smtp: smtplib.SMTP | None = None

    def offer(self, recipient: str) -> str:
        """What the mail server says to a recipient."""
        try:
            if self._smtp is None:
                self._smtp = self._smarthost.connect()
                self._smtp.ehlo_or_helo_if_needed()
                code, text = self._smtp.mail(self._sender)
                if not 200 <= code < 300:
                    self.close()
                    return _line(code, text)
            return _line(*self._smtp.rcpt(recipient))
        except (OSError, ValueError, smtplib.SMTPException) as error:
            self.close()
            return _refusal(error)

    def send(self, mail: bytes) -> str:
        """Hand the mail to those who were accepted; what the mail server says."""
        try:
            if self._smtp is None:
                return "451 the mail server has ended the connection"
            return _line(*self._smtp.data(mail))
        except (OSError, smtplib.SMTPException) as error:
            return _refusal(error)
        finally:
            self.close()

    def close(self) -> None:
        """End the connection."""
        if self._smtp is not None:
            with suppress(OSError, smtplib.SMTPException):  # it has, or does not answer
                self._smtp.quit()
            self._smtp.close()
        self._smtp = None


class Relay:
    """aiosmtpd's hooks: a mail comes in, and goes on to the mail server.

    Args:
        smarthost: The mail server.
        fetch: What reads a fault's recording.
        most: Bytes of the recordings of a mail.
    """

    def __init__(self, smarthost: Smarthost, fetch: Fetch, most: int) -> None:
        self._smarthost = smarthost
        self._fetch = fetch
        self._most = most

    async def handle_RCPT(  # noqa: N802 - aiosmtpd calls it by this name
        self, _server: Any, session: Any, envelope: Any, address: str, _options: list[str]
    ) -> str:
        """Ask the mail server whether it takes it: Alertmanager 0.25 notices no later rejection."""
        if getattr(session, "mail", None) is not envelope:
            await asyncio.to_thread(end, session)
            session.mail = envelope
            session.delivery = Delivery(self._smarthost, envelope.mail_from)
        answer: str = await asyncio.to_thread(session.delivery.offer, address)
        if answer.startswith("2"):
            envelope.rcpt_tos.append(address)
        return answer

    async def handle_RSET(self, _server: Any, session: Any, _envelope: Any) -> str:  # noqa: N802
        """Give a mail up."""
        await asyncio.to_thread(end, session)
        return "250 OK"

    async def handle_QUIT(self, _server: Any, session: Any, _envelope: Any) -> str:  # noqa: N802
        """Give up a mail that was not sent."""
        await asyncio.to_thread(end, session)
        return "221 Bye"

    async def handle_DATA(self, _server: Any, session: Any, envelope: Any) -> str:  # noqa: N802
        """Hand it on."""
        return await asyncio.to_thread(self._send, session.delivery, envelope.original_content)

    def _send(self, delivery: Delivery, mail: bytes) -> str:
        mail, faults = attached(mail, self._fetch, self._most)
        answer = delivery.send(mail)
        if answer.startswith("2"):
            log.info("mail forwarded, %s", f"with {', '.join(faults)}" if faults else "as it was")
        return answer


def end(session: Any) -> None:
    """End the connection to the mail server that a client's mail has."""
    if hasattr(session, "delivery"):
        session.delivery.close()


def _refusal(error: Exception) -> str:
    """What the mail server said, for Alertmanager, which tries again after a 4xx."""
    if isinstance(error, smtplib.SMTPResponseException):
        answer = _line(error.smtp_code, error.smtp_error)
    else:
        answer = _line(451, f"the mail server: {error}")
    log.error("mail not forwarded: %s", answer)
    return answer


def _line(code: int, text: bytes | str) -> str:
    said = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return f"{code if 200 <= code < 600 else 451} {one_line(said)[:400]}"
