"""The dashboards are valid for Grafana 10.4: its schema lacks only what it may leave out."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from support.called import called
from support.committed_dashboards import BOARDS

pytest.importorskip("grafana_foundation_sdk", reason="Grafana's SDK needs Python 3.11")

SDK = "grafana-foundation-sdk==1769699796!10.4.0"
# Newer than 10.4, which ignores them: the values are those that it has anyway.
NEWER = {
    *("allowCustomValue", "legend", "percentChangeColorMode", "perPage", "quick_ranges"),
    "time_options",  # which that one adds in place of them
}
READ = """
import json, sys
from grafana_foundation_sdk.cog import plugins
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models.dashboard import Dashboard
plugins.register_default_plugins()
print(json.dumps(Dashboard.from_json(json.load(sys.stdin)), cls=JSONEncoder))
"""


@pytest.fixture(scope="module")
def sdk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the models of Grafana 10.4."""
    folder = tmp_path_factory.mktemp("sdk")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder]
    subprocess.run([*pip, SDK], check=True, timeout=120)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("uid", BOARDS)
def test_the_models_of_grafana_10_4_read_it(uid: str, sdk: Path):
    board = json.loads(json.dumps(BOARDS[uid]))
    board.pop("__requires")  # of an import by hand
    for annotation in board["annotations"].get("list", ()):  # of Prometheus' data source
        annotation.pop("titleFormat")
        annotation.pop("textFormat")

    argv = [sys.executable, "-c", READ]
    done = called(argv, input=json.dumps(board), env={"PYTHONPATH": str(sdk)}, timeout=60)

    assert _without(json.loads(done.stdout)) == _without(board)


def _without(read: object) -> object:
    """What was read, without the newer keys."""
    if isinstance(read, dict):
        return {key: _without(value) for key, value in read.items() if key not in NEWER}
    return [_without(each) for each in read] if isinstance(read, list) else read
