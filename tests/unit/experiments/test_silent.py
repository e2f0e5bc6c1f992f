"""The table of silent faults that were injected, seen, and notified."""

from __future__ import annotations

from pathlib import Path

from experiments import silent_report
from experiments.results import Results

KILLED = {"injected": "it is killed", "expected": "node lidar", "problems": 1, "recoveries": 1}
STARTED = {"injected": "it is started again", "expected": "", "problems": 0, "recoveries": 0}
NOTHING = {"seen": "", "after": "", "wrong": ""}


def test_each_case_has_a_column_and_each_injection_a_row(tmp_path: Path):
    made = Results(tmp_path, "silent")
    made.begin(append=False, settings={})
    without, bad = {"loss": 0.0, "delay": 0.0}, {"loss": 0.05, "delay": 0.2}
    made.add({**without, **KILLED, **NOTHING, "seen": "node lidar", "after": 21.4})
    made.add({**without, **STARTED, **NOTHING})
    made.add({**bad, **KILLED, **NOTHING, "problems": 0, "recoveries": 0})
    made.add({**bad, **STARTED, **NOTHING, "wrong": "node arm, topic data"})
    assert silent_report.summary(made.rows()) == [
        "| a node, or its process | seen as | 0 % lost | 5 % lost, 200 ms late |",
        "|---|---|---|---|",
        "| it is killed | `node lidar` | 21 s, 1 + 1 mails | not seen |",
        "| it is started again | nothing | - | - |",
        "| faults that nobody injected | | 0 | 2 |",
    ]
    text = silent_report.render(made)
    assert "5 % lost, 200 ms late:" in text
    assert "| it is started again | nothing |  | 0 + 0 | node arm, topic data |" in text
