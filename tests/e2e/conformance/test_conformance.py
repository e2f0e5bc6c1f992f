"""This project notifies as the distribution's Nagios does, but for what differs on purpose."""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace

import pytest

from conformance.compare import Outcome, run, shrunk
from conformance.exporter import TICK
from conformance.histories import WRITTEN, drawn
from conformance.history import Notification
from conformance.table import PAGE, ROWS, rows, summary
from support.called import called
from support.planted import planted

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

# What is planted in faults/: file, the right text, the wrong text, and a history that finds it.
MISTAKES = {
    "confirms one result early": (
        "judge.py",
        "due = book.due(problem)",
        f"due = book.due(problem) - {TICK}",
        "five attempts, four bad results",
    ),
    "notifies what is soft, and its recovery": (
        "judge.py",
        "if now.mono < due:",
        "if now.mono < problem.clock:",
        "a recovery while soft",
    ),
    "a silent robot's fault recovers": (
        "components.py",
        """\
            if state is not _FLAPPING:
                book.give_verdict(problem, _NO_DATA)
""",
        """\
            if state is not _FLAPPING:
                book.give_verdict(problem, _HEALTHY)
""",
        "a service is CRITICAL before its host is down",
    ),
}
# Prints the notifications of the written histories, of the exporter that is imported.
PLAY = """\
import json
from conformance.exporter import play
from conformance.histories import WRITTEN
print(json.dumps([[] if each.of_people else play(each) for each in WRITTEN]))
"""


def wrong(found: Sequence[Outcome]) -> list[Outcome]:
    return [each for each in found if not each.same and not each.reason]


def test_every_history_is_notified_the_same_or_differs_for_a_reason(tmp_path):
    """One test, because the run takes minutes: its result, its table, and planted mistakes."""
    outcomes = run(tmp_path / "all", [*WRITTEN, *drawn()])

    assert len(outcomes) >= 60
    assert not wrong(outcomes), "\n".join(map(str, wrong(outcomes)))
    needless = [each.history.name for each in outcomes if each.same and each.history.reason]
    assert not needless, "a reason is given, and nothing differs"
    assert rows(outcomes) == ROWS.read_text(), "run ./run conformance --write"
    assert summary(outcomes) in PAGE.read_text(), "run ./run conformance --write"
    for mistake, (*change, history) in MISTAKES.items():
        found = with_mistake(outcomes[: len(WRITTEN)], planted(tmp_path / mistake, *change))
        assert history in [each.history.name for each in wrong(found)], f"not found: {mistake}"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_other_histories_that_are_drawn_are_notified_the_same(tmp_path, seed):
    found = wrong(run(tmp_path / "drawn", drawn(seed)))

    assert not found, shrunk(tmp_path / "shrunk", found[0].history)


def with_mistake(written: Sequence[Outcome], environment: dict[str, str]) -> list[Outcome]:
    """The outcomes of the written histories as they are with an exporter that has a mistake."""
    done = called([sys.executable, "-c", PLAY], env=environment)
    played = [[Notification(*each) for each in found] for found in json.loads(done.stdout)]
    return [
        replace(outcome, ours=ours)
        for outcome, ours in zip(written, played, strict=True)
        if not outcome.history.of_people
    ]
