"""Mails that were sent, and those that were not."""

import time
from collections.abc import Callable

from testbed.mail import Inbox, Mail
from testbed.polling import until


def wait_for_mail(inbox: Inbox, *words: str) -> Mail:
    """The first mail whose subject has all these words, once it has come."""

    def found() -> list[Mail]:
        return [each for each in inbox.mails() if all(word in each.subject for word in words)]

    until(found, lambda: f"a mail with {words}: {inbox.subjects()}", 90)
    return found()[0]


def settled(
    subjects: Callable[[], list[str]], number: int, *, within: float, pause: float
) -> list[str]:
    """All subjects, once so many mails have arrived and one too many had its time.

    Args:
        subjects: Those of all mails until now.
        number: Of mails that are waited for.
        within: Seconds in which they have to arrive.
        pause: Seconds in which a mail too many would be sent.

    Raises:
        TimeoutError: Fewer have arrived.
    """
    until(lambda: len(subjects()) >= number, lambda: f"{number} mails: {subjects()}", within)
    then = time.monotonic() + pause
    until(lambda: time.monotonic() >= then, "a mail too many had its time", pause + 30)
    return subjects()
