"""Every bad file in tests/data/configs gets exactly the text that stands beside it."""

from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load

CONFIGS = Path(__file__).parents[2] / "data/configs"
BAD = sorted(CONFIGS.glob("bad-*.yml"))


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_bad_file_is_refused_with_exactly_its_text(path, monkeypatch):
    monkeypatch.chdir(CONFIGS)
    with pytest.raises(ConfigError) as caught:
        load(Path(path.name))
    assert str(caught.value) + "\n" == path.with_suffix(".txt").read_text(encoding="utf-8")


def test_every_text_belongs_to_a_bad_file():
    assert [path.with_suffix(".txt") for path in BAD] == sorted(CONFIGS.glob("bad-*.txt"))
