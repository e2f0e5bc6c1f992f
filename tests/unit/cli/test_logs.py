from __future__ import annotations

import json
import logging
import re
import signal
import subprocess
import sys
import textwrap

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


def records_of(program: str, returncode: int = 0) -> list[dict[str, str]]:
    """What a program that wraps its output writes to standard error, record by record."""
    start = "import ctypes, logging, os, signal, sys\nfrom ros_diagnostics_exporter import logs\n"
    start += "logs.set_up('info', 'json', logs.wrap_output())\n"
    done = subprocess.run(
        [sys.executable, "-c", start + textwrap.dedent(program)],
        capture_output=True,
        timeout=120,
        check=False,
        start_new_session=True,
    )
    assert done.returncode == returncode, done.stderr
    assert done.stdout == b""
    return [json.loads(line) for line in done.stderr.splitlines()]


def test_what_bypasses_the_log_becomes_records_between_those_of_the_log():
    found = records_of("""
        os.write(1, b"\\x1b[31;1mby the middleware\\x1b[m\\n")
        os.write(2, b"half a ")
        os.write(2, b"line\\n\\n \\xff without an end")
        logging.getLogger("own").info("as ever")
        print("from Python", file=sys.stdout)
        """)
    assert {(each["logger"], each["level"], each["msg"]) for each in found} == {
        ("output", "warning", "by the middleware"),
        ("output", "warning", "half a line"),
        ("output", "warning", " \N{REPLACEMENT CHARACTER} without an endfrom Python"),
        ("own", "info", "as ever"),
    }


def test_the_last_words_before_an_abort_are_not_lost():
    found = records_of(
        """
        logging.getLogger("own").info("first")
        os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'\\n")
        os.abort()
        """,
        -signal.SIGABRT,
    )
    assert found[-1]["msg"].startswith("terminate called")


def test_an_exception_that_nobody_catches_is_in_records_too():
    found = records_of("raise ValueError('nobody catches this')", 1)
    assert found[-1]["msg"] == "ValueError: nobody catches this"


def test_a_flood_by_one_that_holds_the_interpreters_lock_is_not_waited_for_in_vain():
    found = records_of("""
        libc = ctypes.PyDLL(None)  # calls hold the lock
        for _ in range(40):
            text = b"x" * 9_999 + b"\\n"
            assert libc.write(2, text, len(text)) == len(text)
        """)
    assert sum(len(each["msg"]) for each in found) == 40 * 9_999
    assert max(len(each["msg"]) for each in found) == logs.LINE_BYTES


def test_a_signal_to_all_processes_does_not_cost_the_last_lines():
    found = records_of("""
        signal.signal(signal.SIGTERM, lambda *_: os.write(2, b"asked to end\\n"))
        os.killpg(0, signal.SIGTERM)
        """)
    assert [each["msg"] for each in found] == ["asked to end"]
