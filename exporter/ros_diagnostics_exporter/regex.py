"""Regular expressions for robots' text, which is not trusted: RE2 takes linear time on all of it.

RE2 is also the dialect of Prometheus and Alertmanager.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import re2

MAX_MEMORY = 1 << 20  # bytes of one expression, compiled and while it runs; RE2's default is 8 MiB
CACHED = 4096  # texts; each array of a shared topic has the same names


class RegexError(ValueError):
    """A text is not a regular expression of RE2; ``str()`` has RE2's reason."""


@dataclass(frozen=True)
class Pattern:
    """One compiled expression; equal to another of the same text and the same flags.

    Args:
        pattern: The expression, in RE2's syntax.
        ignore_case: Whether upper and lower case are the same.
        dot_all: Whether `.` matches a line end as well.

    Raises:
        RegexError: RE2 does not accept the expression.
    """

    pattern: str
    ignore_case: bool = False
    dot_all: bool = False
    _compiled: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        options = re2.Options()
        options.max_mem = MAX_MEMORY
        options.log_errors = False  # they are raised; RE2 would also write them to stderr
        options.case_sensitive = not self.ignore_case
        options.dot_nl = self.dot_all
        try:
            compiled = re2.compile(self.pattern, options)
        except re2.error as error:
            reason = error.args[0]
            text = reason.decode("utf-8", "replace") if isinstance(reason, bytes) else str(reason)
            raise RegexError(text[:80]) from None  # it may quote the whole expression
        object.__setattr__(self, "_compiled", compiled)

    @property
    def groups(self) -> frozenset[str]:
        """The names of the named groups."""
        return frozenset(self._compiled.groupindex)

    def search(self, text: str) -> bool:
        """Whether the expression is found anywhere in ``text``."""
        return self._compiled.search(_encodable(text)) is not None

    def fullmatch(self, text: str) -> Any:
        """The match of the whole ``text``, with the methods of a match of ``re``, or None."""
        return _fullmatch(self._compiled, _encodable(text))


def escape(text: str) -> str:
    """``text`` as an expression that matches just it."""
    escaped: str = re2.escape(text)
    return escaped


@lru_cache(CACHED)
def _fullmatch(compiled: Any, text: str) -> Any:
    return compiled.fullmatch(text)


def _encodable(text: str) -> str:
    """RE2 works on UTF-8, which cannot encode unpaired surrogates."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode()
