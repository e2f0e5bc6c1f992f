"""Results on disk."""

import argparse

import pytest

from experiments import results
from experiments.results import Results, table


def options(tmp_path, **changes):
    return argparse.Namespace(**{"report": False, "append": False, "seed": 3, **changes})


def render(result: Results) -> str:
    rows = result.rows()
    return result.write_markdown(table(rows, [("size", lambda row: row["size"])]))


def test_what_was_measured_before_an_interruption_is_kept(tmp_path, capsys):
    def measure(size):
        if size == 3:
            raise KeyboardInterrupt
        yield {"size": size}

    result = Results(tmp_path, "some")
    results.run(result, options(tmp_path), [1, 2, 3, 4], measure, render)

    assert [row["size"] for row in result.rows()] == ["1", "2"]
    out, err = capsys.readouterr()
    assert "| 2 |" in out
    assert "interrupted; what was measured is kept" in err


def test_a_case_that_fails_is_named_and_the_others_are_measured(tmp_path):
    def measure(size):
        if size == 2:
            raise TimeoutError("2 robots in Prometheus")
        yield {"size": size}

    result = Results(tmp_path, "some")
    with pytest.raises(SystemExit, match="2 failed: 2 robots in Prometheus"):
        results.run(result, options(tmp_path), [1, 2, 3], measure, render)

    assert [row["size"] for row in result.rows()] == ["1", "3"]
    assert "| 3 |" in result.path(".md").read_text()


def test_a_later_run_adds_rows_or_begins_anew(tmp_path):
    result = Results(tmp_path, "some")

    def run(*sizes, append):
        results.run(
            result,
            options(tmp_path, append=append),
            sizes,
            lambda size: [{"size": size, f"only_{size}": 1}],
            render,
        )
        return [row["size"] for row in result.rows()]

    assert run(1, append=False) == ["1"]
    assert run(2, append=True) == ["1", "2"]
    assert result.rows()[0]["only_2"] == ""
    assert run(5, append=False) == ["5"]
