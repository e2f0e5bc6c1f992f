"""A fleet.yml from a text, as the tests of this folder write it."""

from textwrap import dedent

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load


@pytest.fixture
def fleet_of(tmp_path):
    """Loads a text (indented as the test is) as fleet.yml of a folder of its own."""

    def loaded(text, **files):
        for name, content in files.items():
            path = tmp_path / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(".yml").write_text(dedent(content), encoding="utf-8")
        path = tmp_path / "fleet.yml"
        path.write_text(dedent(text), encoding="utf-8")
        return load(path)

    return loaded


@pytest.fixture
def errors_of(fleet_of, tmp_path):
    """The lines of the error that a text gets, without the folder."""

    def lines(text, **files):
        with pytest.raises(ConfigError) as caught:
            fleet_of(text, **files)
        return str(caught.value).replace(f"{tmp_path}/", "").splitlines()

    return lines
