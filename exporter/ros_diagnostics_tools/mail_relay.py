"""Hands Alertmanager's mails on to the mail server, with the capsules of their faults attached.

Alertmanager cannot attach a file. A mail names its faults in the header `FAULTS`; whatever goes
wrong with a capsule, the mail is forwarded as it is. It is accepted once the mail server has it.
"""

from __future__ import annotations

import asyncio
import logging
import re
import smtplib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from email import message_from_bytes, policy
from email.message import EmailMessage
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
    """The mail server; with a user also the file with the password in one line."""

    host: str
    port: int
    starttls: bool = False
    user: str | None = None
    password_file: Path | None = None

    def connect(self) -> smtplib.SMTP:
        """Open a connection, and log in where there is a user.

        Raises:
            OSError, smtplib.SMTPException: it does not answer, or rejects the login.
        """
        smtp = smtplib.SMTP(self.host, self.port, timeout=TIMEOUT)
        try:
            if self.starttls:
                smtp.starttls()
            if self.user is not None and self.password_file is not None:
                smtp.login(self.user, self.password_file.read_text("utf-8").rstrip("\r\n"))
        except BaseException:
            smtp.close()
            raise
        return smtp


Fetch = Callable[[str], "bytes | None"]


def from_exporter(exporter: Client, most: int) -> Fetch:
    """What reads a fault's capsule, of at most so many bytes; None where there is none."""

    def fetch(fault: str) -> bytes | None:
        path = f"/api/v1/faults/{fault}/capsule.mcap?so_far=true"
        try:
            return exporter.download(path, limit=most)
        except UnreachableError as error:
            log.warning("fault %s: its capsule is not attached: %s", fault, one_line(str(error)))
            return None

    return fetch


def attached(mail: bytes, fetch: Fetch, most: int) -> tuple[bytes, list[str]]:
    """A mail with the capsules of its faults, of ``most`` bytes in all, and the faults' ids.

    Without any it is the mail as it was, to the byte.
    """
    message = message_from_bytes(mail, policy=_AS_IT_IS)
    if not isinstance(message, EmailMessage):  # what the policy makes is one
        raise TypeError(f"not an email: {type(message)}")
    found = list(_capsules(dict.fromkeys(_ID.findall(str(message[FAULTS] or ""))), fetch, most))
    for each in found:
        name = f"{each.fault}.mcap"
        message.add_attachment(each.content, "application", "octet-stream", filename=name)
    return message.as_bytes() if found else mail, [each.fault for each in found]


def _capsules(faults: dict[str, None], fetch: Fetch, most: int) -> Iterator[Attachment]:
    left = most
    for fault in faults:
        content = fetch(fault) if left > 0 else None
        if content is not None and len(content) <= left:
            left -= len(content)
            yield Attachment(fault, content)


class Relay:
    """aiosmtpd's hooks: a mail comes in, and goes on to the mail server.

    Args:
        smarthost: The mail server.
        fetch: What reads a fault's capsule.
        most: Bytes of the capsules of a mail.
    """

    def __init__(self, smarthost: Smarthost, fetch: Fetch, most: int) -> None:
        self._smarthost = smarthost
        self._fetch = fetch
        self._most = most

    async def handle_RCPT(  # noqa: N802 - aiosmtpd calls it by this name
        self, _server: Any, _session: Any, envelope: Any, address: str, _options: list[str]
    ) -> str:
        """Ask the mail server whether it takes it: Alertmanager 0.25 notices no later rejection."""
        answer = await asyncio.to_thread(self._accepts, envelope.mail_from, address)
        if answer.startswith("2"):
            envelope.rcpt_tos.append(address)
        return answer

    async def handle_DATA(self, _server: Any, _session: Any, envelope: Any) -> str:  # noqa: N802
        """Hand it on."""
        sender, recipients = envelope.mail_from, list(envelope.rcpt_tos)
        return await asyncio.to_thread(self._send, sender, recipients, envelope.original_content)

    def _accepts(self, sender: str, recipient: str) -> str:
        try:
            with self._smarthost.connect() as smtp:
                smtp.ehlo_or_helo_if_needed()
                for code, text in (smtp.mail(sender), smtp.rcpt(recipient)):
                    if not 200 <= code < 300:
                        return _line(code, text)
        except (OSError, smtplib.SMTPException) as error:
            return _refusal(error)
        return "250 OK"

    def _send(self, sender: str, recipients: list[str], mail: bytes) -> str:
        mail, faults = attached(mail, self._fetch, self._most)
        try:
            with self._smarthost.connect() as smtp:
                refused = smtp.sendmail(sender, recipients, mail)
        except (OSError, smtplib.SMTPException) as error:
            return _refusal(error)
        for recipient, (code, text) in refused.items():
            log.warning("%s: rejected: %s", one_line(recipient), _line(code, text))
        log.info("mail forwarded, %s", f"with {', '.join(faults)}" if faults else "as it was")
        return "250 OK"


def _refusal(error: Exception) -> str:
    """What the mail server said, for Alertmanager, which tries again after a 4xx."""
    if isinstance(error, smtplib.SMTPResponseException):
        answer = _line(error.smtp_code, error.smtp_error)
    elif isinstance(error, smtplib.SMTPRecipientsRefused):
        answer = _line(*next(iter(error.recipients.values())))
    else:
        answer = _line(451, f"the mail server: {error}")
    log.error("mail not forwarded: %s", answer)
    return answer


def _line(code: int, text: bytes | str) -> str:
    said = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return f"{code if 200 <= code < 600 else 451} {one_line(said)[:400]}"
