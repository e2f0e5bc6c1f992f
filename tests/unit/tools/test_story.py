from __future__ import annotations

import json

from ros_diagnostics_tools.main import main

STORY = {
    "fleet": "hall",
    "robot": "r 1",
    "time": 1_060.0,
    "since": 10.0,
    "sentences": [
        {"about": "Motor", "text": "Motor was faulty once."},
        {"about": "Motor", "text": "ann has it: \x1b[31mred."},
        {"about": "Lidar", "text": "Lidar was faulty 2 times."},
    ],
}


def test_the_sentences_of_one_part_are_one_line(serve, capsys):
    asked = []
    server = serve(story=lambda robot: asked.append(robot) or STORY)
    url = f"http://{server.addresses[0]}"

    assert main(["story", "r 1", "--url", url]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("Motor was faulty once. ann has it: ")
    assert "\x1b" not in first
    assert second == "Lidar was faulty 2 times."
    assert main(["story", "r/1\n", "--url", url, "--output", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == STORY
    assert asked == ["r 1", "r/1\n"]
