"""What part of the time of all tests each folder takes, against tests/time_budget.yml."""

from collections import Counter
from collections.abc import Iterable

import yaml

from testbed.configuration import CHECKOUT

FILE = CHECKOUT / "tests" / "time_budget.yml"


def budgets() -> dict[str, int]:
    """Folder below tests/ -> per cent."""
    found: dict[str, int] = yaml.safe_load(FILE.read_text())
    return found


def exceeded(durations: Iterable[tuple[str, float]], limits: dict[str, int]) -> list[str]:
    """A line for each folder that takes more than its part; none where not all folders were run.

    Args:
        durations: Node ids with seconds, any number for each.
        limits: As `budgets` gives them.
    """
    seconds: Counter[str] = Counter()
    for test, taken in durations:
        path = test.removeprefix("tests/")
        within = [each for each in limits if path.startswith(f"{each}/")]
        seconds[max(within, key=len, default="")] += taken
    if not seconds.keys() >= limits.keys():
        return []
    shares = {each: 100 * seconds[each] / seconds.total() for each in limits}
    return [
        f"tests/{each} takes {share:.0f} % of the time of all tests; "
        f"{FILE.name} allows {limits[each]} %"
        for each, share in shares.items()
        if share > limits[each]
    ]
