"""Who may ask: basic authentication against bcrypt hashes, and a limit of requests.

bcrypt costs a tenth of a second by design, so what was right once is remembered for as long as the
hash stays the same; what was wrong is computed again each time, in one thread, few waiting.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
from collections import OrderedDict
from collections.abc import Mapping

import bcrypt

from ros_diagnostics_exporter.web.workers import Calls

REMEMBERED = 100  # logins
CLIENTS = 1_000  # addresses whose requests are counted
BCRYPT_BYTES = 72  # bcrypt looks at no more of a password


def parse_basic(header: str) -> tuple[str, bytes] | None:
    """User and password of an Authorization header, None when it is something else."""
    scheme, _, coded = header.partition(" ")
    if scheme.lower() != "basic":
        return None
    try:
        user, colon, password = base64.b64decode(coded.strip(), validate=True).partition(b":")
    except (binascii.Error, ValueError):
        return None
    return (user.decode("utf-8", "replace"), password) if colon else None


class Logins:
    """Tells right logins from wrong ones, both in the same time for all users, known or not."""

    def __init__(self) -> None:
        self._calls = Calls("web-auth", threads=1, waiting=20)
        self._secret = secrets.token_bytes(32)
        self._right: OrderedDict[bytes, None] = OrderedDict()

    async def allows(self, users: Mapping[str, str], header: str) -> bool:
        """Whether ``header`` is a login of one of ``users`` (name -> bcrypt hash).

        Raises:
            BusyError: Too many logins wait to be checked.
        """
        login = parse_basic(header)
        if login is None:
            return False
        user, password = login
        hashed = users.get(user) or _nobody(users)
        mark = self._mark(user, hashed, password)
        if mark in self._right:
            return True
        right = await self._calls.run(_matches, password, hashed) and user in users
        if right:
            self._remember(mark)
        return right

    def close(self) -> None:
        """End the thread."""
        self._calls.close()

    def _mark(self, user: str, hashed: str, password: bytes) -> bytes:
        """What is remembered of a login: nothing that tells the password, of a fixed length."""
        parts = (hashlib.sha256(part).digest() for part in (user.encode(), hashed.encode()))
        return hmac.digest(self._secret, b"".join(parts) + password, "sha256")

    def _remember(self, mark: bytes) -> None:
        self._right[mark] = None
        if len(self._right) > REMEMBERED:
            self._right.popitem(last=False)


def _matches(password: bytes, hashed: str) -> bool:
    if b"\0" in password:
        return False
    return bcrypt.checkpw(password[:BCRYPT_BYTES], hashed.encode())


def _nobody(users: Mapping[str, str]) -> str:
    """A hash that no password has, as costly as the users' own: an unknown name takes as long."""
    cost = max((hashed[4:6] for hashed in users.values()), default="10")
    return f"$2b${cost}$" + "." * 53


class Bucket:
    """A token bucket: one request every ``interval`` seconds, and ``burst`` saved up at most."""

    def __init__(self) -> None:
        self._tokens = float("inf")
        self._then = 0.0

    def take(self, interval: float, burst: int, now: float) -> bool:
        """Whether a request may pass at ``now`` (monotonic seconds); interval 0 lets all pass."""
        if interval <= 0:
            return True
        self._tokens = min(burst, self._tokens + (now - self._then) / interval)
        self._then = now
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True


class Buckets:
    """A bucket for each client's address; of too many, the one that asked longest ago is lost."""

    def __init__(self) -> None:
        self._buckets: OrderedDict[str, Bucket] = OrderedDict()

    def take(self, address: str, interval: float, burst: int, now: float) -> bool:
        """As Bucket.take, for the bucket of ``address``."""
        if interval <= 0:
            return True
        bucket = self._buckets.setdefault(address, Bucket())
        self._buckets.move_to_end(address)
        if len(self._buckets) > CLIENTS:
            self._buckets.popitem(last=False)
        return bucket.take(interval, burst, now)
