"""Events of aborted goals and of interventions -> because of what they were, in sentences. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from ros_diagnostics_exporter.events import MOMENTS

MOST = 3  # problems that are named with an action


def aborted_texts(events: Iterable[dict[str, Any]], when: str) -> Iterator[tuple[str, str]]:
    """What each sentence is about, an action or "", and the sentence; the most frequent first."""
    found: dict[str, list[dict[str, Any]]] = {}
    for event in events:
        if event["kind"] in MOMENTS:
            found.setdefault(event.get("component", ""), []).append(event)
    for action, each in sorted(found.items(), key=lambda pair: (-len(pair[1]), pair[0])):
        yield action, f"{_counted(action, len(each))} {when}{_while(each)}."


def _counted(action: str, number: int) -> str:
    """How often something happened; without an action it is an intervention."""
    if not action:
        return f"There {'was' if number == 1 else 'were'} {number} intervention{'s' * (number > 1)}"
    if number == 1:
        return f"One goal of {action} was aborted"
    return f"{number} goals of {action} were aborted"


def _while(events: list[dict[str, Any]]) -> str:
    """What else was wrong at these moments, most often first."""
    wrong = Counter(
        (each["about"], each["state"])
        for event in events
        for each in event.get("details", {}).get("problems", ())
    )
    texts = [
        f"{number} of them while {about} was {state}"
        if len(events) > 1
        else f"while {about} was {state}"
        for (about, state), number in wrong.most_common(MOST)
    ]
    return f": {', '.join(texts)}" if texts else ""
