from __future__ import annotations

import json
import logging
import re

import pytest

from ros_diagnostics_exporter import logs

LOG = logging.getLogger("some.room")
FORGED = 'ok\nts=1 level=error msg="forged" \x1b[2J\x9b'


@pytest.fixture
def written(capsys):
    """What was logged since the last look, in the form that ``set_up`` was told."""
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    yield lambda: capsys.readouterr().err
    root.handlers[:] = before
    root.setLevel(level)


def test_logfmt_is_one_line_a_record_whatever_it_says(written):
    logs.set_up("info", "logfmt")
    LOG.warning("robot %s", FORGED)
    LOG.debug("not shown")
    text = written()
    assert text.count("\n") == 1
    assert not set(text) & set("\x1b\x9b")
    assert re.match(
        r"ts=\d{4}-\d\d-\d\dT[\d:]{8}\.\d{3}Z level=warning logger=some\.room msg=\"", text
    )


def test_json_is_one_object_a_record_with_its_error(written):
    logs.set_up("info", "json")
    LOG.error("went wrong", exc_info=ValueError(FORGED))
    said = json.loads(written())
    assert (said["level"], said["logger"], said["msg"]) == ("error", "some.room", "went wrong")
    assert f"ValueError: {FORGED}" in said["error"]


def test_words_that_need_no_quotes_have_none(written):
    logs.set_up("info", "logfmt")
    LOG.info("plain")
    LOG.info("a=b c")
    first, second = written().splitlines()
    assert first.endswith(" msg=plain")
    assert second.endswith(' msg="a=b c"')
