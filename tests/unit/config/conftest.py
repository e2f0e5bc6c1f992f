"""A fleet.yml from a text, as the tests of this folder write it."""

from textwrap import dedent

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load


@pytest.fixture
def fleet_of(tmp_path):
    """Loads a text (indented as the test is) as fleet.yml, with other files beside it."""

    def loaded(text, **beside):
        for name, content in beside.items():
            path = tmp_path / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(dedent(content), encoding="utf-8")
        path = tmp_path / "fleet.yml"
        path.write_text(dedent(text), encoding="utf-8")
        return load(path)

    return loaded


@pytest.fixture
def errors_of(fleet_of, tmp_path):
    """The lines of the error that a text gets, without the folder."""

    def lines(text, **beside):
        with pytest.raises(ConfigError) as caught:
            fleet_of(text, **beside)
        return str(caught.value).replace(f"{tmp_path}/", "").splitlines()

    return lines
