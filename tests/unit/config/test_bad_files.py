"""Every bad file in tests/data/configs gets the error text in the file beside it.

`pytest --update` rewrites the texts.
"""

from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load

CONFIGS = Path(__file__).parents[2] / "data/configs"
BAD = sorted(CONFIGS.glob("bad-*.yml"))


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_bad_file_is_rejected_with_its_text(path, monkeypatch, expect_text):
    monkeypatch.chdir(CONFIGS)
    with pytest.raises(ConfigError) as caught:
        load(Path(path.name))
    expect_text(str(caught.value) + "\n", path.with_suffix(".txt"))


def test_every_text_belongs_to_a_bad_file():
    assert [path.with_suffix(".txt") for path in BAD] == sorted(CONFIGS.glob("bad-*.txt"))
