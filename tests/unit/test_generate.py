"""The generated files are current, and `./run generate` writes and names those that are not."""

import pytest

import generate
import mail_pictures


@pytest.mark.parametrize("name", generate.GENERATORS)
def test_the_generated_files_are_current(name: str):
    if name in {"dashboards", "mixin"}:
        pytest.importorskip(generate.SDK, reason="Grafana's SDK needs Python 3.11")

    assert not generate.stale(generate.GENERATORS[name]()), "./run generate writes them"


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Generated are a file that is current, a wrong one, one to make, and one to delete."""
    (tmp_path / "current").write_text("new")
    (tmp_path / "wrong").write_text("old")
    (tmp_path / "former").write_text("old")
    wanted = {"current": "new", "wrong": "new", "added": "new", "former": None}
    made = {tmp_path / name: text for name, text in wanted.items()}
    monkeypatch.setattr(generate, "GENERATORS", {"these": lambda: made})
    monkeypatch.setattr(mail_pictures, "PICTURES", {})
    return tmp_path


def content(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_check_names_what_is_stale_and_writes_nothing(files, capsys):
    before = content(files)

    assert generate.main(["--check"]) == 1

    named = [line.split()[0] for line in capsys.readouterr().err.splitlines()]
    assert named == [str(files / name) for name in ("wrong", "added", "former")]
    assert content(files) == before


def test_what_is_stale_is_written_and_then_nothing_is(files, capsys):
    assert generate.main([]) == 0
    assert content(files) == dict.fromkeys(("current", "wrong", "added"), "new")
    assert generate.main(["--check"]) == 0
    assert not capsys.readouterr().err


def test_without_the_dashboards_sdk_the_rest_is_looked_at(files, monkeypatch, capsys):
    def dashboards():
        raise ModuleNotFoundError(name=generate.SDK)

    monkeypatch.setitem(generate.GENERATORS, "dashboards", dashboards)

    assert generate.main(["--check"]) == 1

    note, *stale = capsys.readouterr().err.splitlines()
    assert note.startswith("dashboards: not looked at: ")
    assert len(stale) == 3
