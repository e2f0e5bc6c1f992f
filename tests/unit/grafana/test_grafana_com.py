"""The dashboards of a release are what grafana.com and Grafana's import take."""

import json
import re
import subprocess
import sys

import pytest

from support.committed_dashboards import BOARDS
from testbed.configuration import CHECKOUT


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """What the script writes, as a release runs it, by uid."""
    folder = tmp_path_factory.mktemp("dist") / "dashboards"
    script = CHECKOUT / "tools" / "grafana_com.py"
    subprocess.run([sys.executable, "-I", script, folder], check=True)
    return {path.stem: json.loads(path.read_text()) for path in folder.iterdir()}


def test_each_dashboard_is_the_shipped_one_with_what_it_requires(written):
    assert written.keys() == BOARDS.keys()
    for uid, found in written.items():
        board = dict(found)
        required = board["__requires"]
        assert (board.pop("__inputs"), board.pop("__elements"), board.pop("id")) == ([], {}, None)
        assert board == BOARDS[uid]
        text = json.dumps(board)
        kinds = {each["id"] for each in required if each["type"] == "panel"}
        assert all(f'"type": "{kind}"' in text for kind in kinds)
        assert {"table", "stat"} & kinds
        assert set(re.findall(r'"datasource": \{"type": "(\w+)"', text)) == {"prometheus"}


def test_the_oldest_grafana_is_that_of_the_page(written):
    page = (CHECKOUT / "docs" / "dashboards.md").read_text()
    (oldest,) = re.findall(r"You need Grafana (\S+) or later", page)

    for board in written.values():
        assert board["__requires"][0]["version"] == f"{oldest}.0"
