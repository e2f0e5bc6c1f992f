"""A failing story, reduced to the few events that it takes."""

from __future__ import annotations

from dataclasses import replace

from simulation.checks import BrokenError, Judge
from simulation.story import PERIOD, Event, Story


def failure(story: Story) -> BrokenError | None:
    """What is wrong with the exporter by this story; None: nothing."""
    try:
        Judge(story).run()
    except BrokenError as error:
        return error
    return None


def shrink(story: Story, error: BrokenError) -> tuple[Story, BrokenError]:
    """The same failure, with as few events as removing them one after another leaves."""
    story = _until(story, error)
    size = max(1, len(story.events) // 2)
    while size:
        position = 0
        while position < len(story.events):
            events = story.events[:position] + story.events[position + size :]
            found = failure(replace(story, events=events))
            if found is not None and found.what == error.what:
                story, error = _until(replace(story, events=events), found), found
            else:
                position += size
        size //= 2
    return _sooner(story, error)


def _until(story: Story, error: BrokenError) -> Story:
    """The story up to its failure."""
    events = tuple(event for event in story.events if event.at <= error.tick)
    return replace(story, ticks=error.tick, events=events)


def _sooner(story: Story, error: BrokenError) -> tuple[Story, BrokenError]:
    """The same story without the time before its first event."""
    if not story.events:
        return story, error
    early = max(0, story.events[0].at - 3 * PERIOD)
    early -= early % PERIOD
    events = tuple(event._replace(at=event.at - early) for event in story.events)
    sooner = replace(story, events=events, ticks=story.ticks - early)
    found = failure(sooner)
    return (story, error) if found is None or found.what != error.what else (sooner, found)


def as_test(story: Story) -> str:
    """The story as Python, to be put into tests/unit/simulation."""
    events = "".join(f"    {_written(event)},\n" for event in story.events)
    of = f"{story.seed}, {story.robots}, {story.ticks}, (), able={story.able}"
    return f"(\n    Story({of}),\n{events})"


def _written(event: Event) -> str:
    return f"Event({event.at}, {event.what!r}, {event.who!r}, {event.how!r})"
