"""What `./run simulate` prints of a failing seed: the events that it takes, as Python."""

from simulation import shrink
from simulation.checks import BrokenError
from simulation.story import PERIOD, Event, Story


def test_a_failure_is_reduced_to_the_events_that_it_takes(monkeypatch):
    """Planted: it fails once both r001 and r007 are off, and otherwise if r005 is never off."""

    class Judge:
        def __init__(self, story: Story) -> None:
            self.story = story

        def run(self) -> None:
            off = {each.who: each.at for each in self.story.events if each.what == "off"}
            if {"r001", "r007"} <= off.keys():
                raise BrokenError("missed", max(off["r001"], off["r007"]), "r007")
            if "r005" not in off:
                raise BrokenError("made up", self.story.ticks, "r005")

    monkeypatch.setattr(shrink, "Judge", Judge)
    events = (
        *(Event(43 + number, "off", f"r{number:03d}", (True,)) for number in range(10)),
        *(Event(90 + number, "level", "r001", ("part 1", 2)) for number in range(10)),
    )
    story = Story(seed=3, robots=10, ticks=500, events=events, able=True)
    error = shrink.failure(story)
    assert (error.what, error.tick) == ("missed", 50)

    shortest, error = shrink.shrink(story, error)

    begin = 44 - (44 - 3 * PERIOD) // PERIOD * PERIOD
    taken = (Event(begin, "off", "r001", (True,)), Event(begin + 6, "off", "r007", (True,)))
    assert shortest == Story(seed=3, robots=10, ticks=begin + 6, events=taken, able=True)
    assert (error.what, error.tick) == ("missed", begin + 6)
    assert eval(shrink.as_test(shortest), {"Story": Story, "Event": Event}) == (
        Story(3, 10, begin + 6, (), able=True),
        *taken,
    )
