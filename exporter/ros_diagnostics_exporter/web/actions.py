"""Forms of the pages: a person who has logged in acknowledges a fault, or plans a downtime.

Off unless the exporter is started with --web.enable-actions. A request has to be a POST of a form
of this exporter's page: by its headers, which pages of other sites cannot set, and by its token,
which they cannot read.
"""

from __future__ import annotations

import hmac
import logging
import re
import secrets
import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple
from urllib.parse import parse_qsl, quote, unquote, urlsplit

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.model import Person
from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.middleware import parse_basic
from ros_diagnostics_exporter.web.pages import DOWNTIMES, rejected
from ros_diagnostics_exporter.web.responses import Workers

MAX_FORM = 16 << 10  # bytes
MAX_COMMENT = 200  # characters
_TIME = re.compile(r"[0-9]{1,12}(\.[0-9]{1,6})?", re.ASCII)
_TIME_OF_DAY = re.compile(r"([01][0-9]|2[0-3]):([0-5][0-9])(?::00)?", re.ASCII)
DAY = 86_400.0  # seconds of a day in UTC
_FORM = "application/x-www-form-urlencoded"

_log = logging.getLogger(__name__)


class _RejectedError(Exception):
    """The form is not followed: HTTP status, and a sentence for the person."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class _Form(NamedTuple):
    fields: dict[str, str]
    person: Person


class Actions:
    """The forms' endpoints, and the token that a page puts into its forms.

    Args:
        backend: What acts.
        asking: Where it is called: Alertmanager is asked, which may hang.
        enabled: Whether anybody may act.

    Attributes:
        enabled: As given.
    """

    def __init__(self, backend: Backend, asking: Workers, *, enabled: bool) -> None:
        self._backend = backend
        self._asking = asking
        self.enabled = enabled
        self._secret = secrets.token_bytes(32)

    def token(self, request: Request) -> str | None:
        """The token of who asks for a page with forms; None where they may not act."""
        user = _user(request)
        return self._token_of(user) if self.enabled and user is not None else None

    def _token_of(self, user: str) -> str:
        return hmac.new(self._secret, user.encode("utf-8", "replace"), "sha256").hexdigest()

    async def acknowledge(self, request: Request) -> Response:
        """Acknowledge a fault that lasts, with fields ``fault`` and ``comment``."""

        async def act(form: _Form) -> str:
            fault = form.fields["fault"]
            await self._asking.run(self._backend.acknowledge, fault, form.person)
            return f"../faults/{quote(fault, safe='')}?done=acknowledged"

        return await self._act(request, {"fault", "comment"}, act)

    async def downtime(self, request: Request) -> Response:
        """Plan a downtime of a robot or component, with ``robot``, ``component``, ``for``.

        ``from`` is a time of day in UTC, as 22:00: the next one; "" is now.
        """

        async def act(form: _Form) -> str:
            robot, lasts = form.fields["robot"], form.fields["for"]
            if lasts not in DOWNTIMES:
                raise _RejectedError(400, f"{lasts!r:.20} is not one of {', '.join(DOWNTIMES)}.")
            begin = _begin(form.fields["from"], time.time())
            given = robot, form.fields["component"], begin, durations.parse(lasts)
            await self._asking.run(self._backend.plan_downtime, *given, form.person)
            return f"../robots/{quote(robot, safe='')}?done=downtime"

        return await self._act(request, {"robot", "component", "from", "for", "comment"}, act)

    async def cancel_downtime(self, request: Request) -> Response:
        """End a downtime, with ``robot``, ``component``, and ``until`` when it lasts, Unix time."""

        async def act(form: _Form) -> str:
            robot, written = form.fields["robot"], form.fields["until"]
            if not _TIME.fullmatch(written):
                raise _RejectedError(400, f"{written!r:.20} is no time.")
            given = robot, form.fields["component"], float(written)
            await self._asking.run(self._backend.cancel_downtime, *given, form.person)
            return f"../robots/{quote(robot, safe='')}?done=cancelled"

        return await self._act(request, {"robot", "component", "until", "comment"}, act)

    async def _act(
        self, request: Request, names: set[str], act: Callable[[_Form], Awaitable[str]]
    ) -> Response:
        """Check the form, do what it says, and lead to the page that shows it."""
        try:
            page = await act(await self._checked(request, names))
        except _RejectedError as error:
            return self._reject(request, error.status, str(error))
        except LookupError as error:
            return self._reject(request, 409, _sentence(str(error.args[0])))
        except ConnectionError as error:
            return self._reject(request, 502, _sentence(str(error)))
        return RedirectResponse(page, status_code=303)

    def _reject(self, request: Request, status: int, why: str) -> Response:
        address = request.scope["state"]["connection"].address
        _log.warning("form of %s from %s: %d: %s", _user(request) or "?", address, status, why)
        return HTMLResponse(rejected(why), status_code=status)

    async def _checked(self, request: Request, names: set[str]) -> _Form:
        connection, user = request.scope["state"]["connection"], _user(request)
        if not self.enabled:
            raise _RejectedError(403, "Forms are not enabled (--web.enable-actions).")
        if user is None:
            raise _RejectedError(403, "Log in first.")
        if not _is_of_own_page(request):
            raise _RejectedError(403, "This form was not sent by a page of this exporter.")
        fields = await _fields(request)
        token = fields.pop("token", "")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self._token_of(user).encode()):
            raise _RejectedError(
                403,
                "The exporter was restarted after the page was loaded: load it again, then send.",
            )
        if fields.keys() != names:
            raise _RejectedError(
                400, f"The form lacks a field; it has to have {', '.join(sorted(names))}."
            )
        return _Form(fields, Person(user, _comment(fields["comment"]), connection.address))


def _begin(time_of_day: str, now: float) -> float:
    """The next moment (Unix time) at which it is that time of day in UTC; "" is now."""
    if not time_of_day:
        return now
    found = _TIME_OF_DAY.fullmatch(time_of_day)
    if found is None:
        raise _RejectedError(400, f"{time_of_day!r:.20} is no time of day such as 22:00.")
    wanted = 3600.0 * int(found[1]) + 60.0 * int(found[2])
    return now + (wanted - now) % DAY


def _comment(text: str) -> str:
    comment = " ".join(text.split())
    if not comment:
        raise _RejectedError(400, "The comment is empty: say what it is about.")
    if len(comment) > MAX_COMMENT:
        raise _RejectedError(400, f"The comment has more than {MAX_COMMENT} characters.")
    return comment


def _user(request: Request) -> str | None:
    """Who has logged in; the middleware has checked the password."""
    login = parse_basic(request.headers.get("authorization", ""))
    return login[0] if login and request.scope["state"]["connection"].authenticated else None


def _is_of_own_page(request: Request) -> bool:
    """Whether a browser says so; that of a name is enough, as the login is of this name only."""
    headers = request.headers
    if headers.get("sec-fetch-site", "same-origin") != "same-origin":
        return False
    page = headers.get("origin", headers.get("referer"))
    if page is None:
        return True  # no browser; the token is checked as well
    try:
        return urlsplit(page).netloc.lower() == headers.get("host", "").lower() != ""
    except ValueError:  # not a URL
        return False


async def _fields(request: Request) -> dict[str, str]:
    """The fields of a form, each once."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != _FORM:
        raise _RejectedError(415, f"A form is sent as {_FORM}.")
    body = b""
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_FORM:
            raise _RejectedError(413, f"The form has more than {MAX_FORM} bytes.")
    if not body:
        return {}
    try:
        pairs = parse_qsl(
            body.decode("ascii"), keep_blank_values=True, strict_parsing=True, errors="strict",
            max_num_fields=10,
        )  # fmt: skip
    except ValueError as error:
        raise _RejectedError(400, "This is no form.") from error
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise _RejectedError(400, "The form has a field twice.")
    # In a page's forms they are quoted: as they are, a browser changes control characters of them.
    return {
        name: unquote(text) if name in {"robot", "component"} else text
        for name, text in fields.items()
    }


def _sentence(why: str) -> str:
    return f"{why[:1].upper()}{why[1:]}."
