"""What a run skipped and why, and which tests may be (`--no-skips`): tests/allowed_skips.yml."""

from collections import Counter
from collections.abc import Iterable

import yaml

from testbed.configuration import CHECKOUT

LIST = CHECKOUT / "tests" / "allowed_skips.yml"
MOST = 3


def allowed() -> dict[str, str]:
    """The reasons that pytest prints of skips that are no failure, each with why that is so."""
    found: dict[str, str] = yaml.safe_load(LIST.read_text()) or {}
    return found


def table(skipped: Iterable[tuple[str, int, str]]) -> list[str]:
    """How many skips (file, line, reason) have each reason, the most first; [] without any."""
    reasons = Counter(reason.removeprefix("Skipped: ") for _path, _line, reason in skipped)
    if not reasons:
        return []
    lines = [f"{number:>6}  {reason}" for reason, number in reasons.most_common()]
    return [f"tests not run: {reasons.total()}", *lines]


def refused(skipped: Iterable[tuple[str, int, str]]) -> list[str]:
    """A line for each skip (file, line, reason) that is not allowed."""
    fine = allowed()
    return [
        f"skipped, which is a failure here: {path}:{line}: {reason}"
        for path, line, reason in skipped
        if reason.removeprefix("Skipped: ") not in fine
    ]
