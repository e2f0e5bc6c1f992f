"""``./run simulate``: one seed or many, and the story of one that fails."""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

from simulation import features, network, planted, reloads, shards, sources, twins
from simulation.checks import BrokenError, Judge
from simulation.shrink import as_test, shrink
from simulation.story import Story, generate

LONGEST = 60  # seconds for one history of `--features`
OF_LONGER = 5  # of as many seeds one plays `sources` and `reloads`, which take longer


def main() -> int:
    """Play the seeds; 1 where one of them fails."""
    options = _parser().parse_args()
    if options.planted:
        return planted.main(options.features, options.seed)
    if options.shards:
        return _play_shards(options.shards, options.seed)
    if options.features:
        return _play_features(range(options.seed, options.seed + options.features))
    for seed in range(options.seed, options.seed + options.seeds):
        story = generate(seed, options.robots, options.days, lose=options.lose, able=options.able)
        begin = time.perf_counter()
        judge = Judge(story)
        try:
            judge.run()
        except BrokenError as error:
            _explain(story, error, reduce=not options.no_shrink)
            return 1
        seconds = time.perf_counter() - begin
        print(
            f"seed {seed}: {options.robots} robots, {options.days:g} days, {len(story.events)} "
            f"events, {judge.notified} faults, {len(judge.mails.sent)} mails in {seconds:.1f} s: "
            f"{options.days * 86_400 / seconds:,.0f} times real time",
            flush=True,
        )
    return 0


def _play_features(seeds: range) -> int:
    """Play short histories of a small fleet that uses every feature.

    And of two nodes of one name, of robots behind a bad network, and now and then one of a robot
    with topics, goals, nodes and a query, and one in which fleet.yml changes all the time. Returns
    1 where one fails.
    """
    logging.disable()  # robots that are odd are logged, thousands of times
    begin, seed, steps = time.perf_counter(), seeds.start, list[tuple[Any, ...]]()
    signal.signal(signal.SIGALRM, _does_not_end)
    try:
        for seed in seeds:
            signal.alarm(LONGEST)
            steps = [*features.random_history(seed)]
            features.play(steps)
            steps = [*network.random_steps(seed)]
            network.play(seed)
            steps = []
            twins.play(seed)
            if seed % OF_LONGER == 0:
                steps = [*sources.random_steps(seed)]
                sources.play(seed)
                steps = [*reloads.random_steps(seed)]
                reloads.play(seed)
    except Exception as error:  # noqa: BLE001 - of whatever kind: the seed is what is needed
        *_, last = traceback.extract_tb(error.__traceback__)
        print(f"seed {seed} fails: {error!r}\nin {last.name}: {last.line}", flush=True)
        print(steps, flush=True)
        return 1
    signal.alarm(0)
    seconds = time.perf_counter() - begin
    print(f"{len(seeds)} histories of a fleet that uses every feature in {seconds:.0f} s")
    return 0


def _play_shards(robots: int, seed: int) -> int:
    """Play a history of a fleet of so many robots that several exporters share."""
    logging.disable()
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            fleet = shards.play(Path(folder), robots, seed)
        except AssertionError as error:
            print(f"seed {seed} fails: {error}", flush=True)
            return 1
    seconds = time.perf_counter() - begin
    print(
        f"seed {seed}: {robots} robots of two exporters, then three, of which one dies: "
        f"{len(fleet.begun())} faults, {len(fleet.sent)} mails, none lost and none twice, "
        f"in {seconds:.0f} s"
    )
    return 0


def _does_not_end(_signal: int, _frame: object) -> None:
    raise TimeoutError(f"the engine works for {LONGEST} s on a history that takes 0.1 s")


def _explain(story: Story, error: BrokenError, *, reduce: bool) -> None:
    print(f"seed {story.seed} fails: {error}", flush=True)
    if not reduce:
        return
    print(f"reducing its {len(story.events)} events ...", flush=True)
    shortest, error = shrink(story, error)
    print(f"{error}\n{as_test(shortest)}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="./run simulate",
        description="Play seeded histories of a fleet through the exporter's state and judgement "
        "of faults, and check after each event that nothing is missed, sent twice or made up.",
    )
    parser.add_argument("--seed", type=int, default=1, help="the first seed (default: 1)")
    parser.add_argument("--seeds", type=int, default=1, help="how many of them (default: 1)")
    parser.add_argument("--robots", type=int, default=20, help="robots of the fleet (default: 20)")
    parser.add_argument("--days", type=float, default=30, help="simulated days (default: 30)")
    parser.add_argument(
        "--lose",
        action="store_true",
        help="the exporter loses its database now and then, and the clock is set by months",
    )
    parser.add_argument(
        "--able",
        action="store_true",
        help="judge what the robots can do, too, by parts of which some fail together",
    )
    parser.add_argument(
        "--features",
        type=int,
        metavar="N",
        default=0,
        help="in place of all that: N short histories of a small fleet that uses every feature",
    )
    parser.add_argument(
        "--shards",
        type=int,
        metavar="ROBOTS",
        default=0,
        help="in place of all that: a fleet of so many robots that exporters share; one of them is "
        "added, and one dies",
    )
    parser.add_argument(
        "--planted",
        action="store_true",
        help="plant each known mistake of faults/ in a copy, and play it the histories of "
        "--features: which check finds it, and after how many?",
    )
    parser.add_argument(
        "--no-shrink", action="store_true", help="do not reduce a failing seed to a few events"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
