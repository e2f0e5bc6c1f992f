import atexit
import io
import json
import logging
import re
import signal
import subprocess
import sys
import textwrap
import threading
from functools import partial

import pytest

from ros_diagnostics_exporter import logs
from ros_diagnostics_exporter.cli.main import LOGGED_UNDER_LOCK
from ros_diagnostics_exporter.model import Array, Status, Topic
from ros_diagnostics_exporter.robots.limits import MAX_TEXT
from support.state_driver import ERROR, StateDriver

LOG = logging.getLogger("some.module")
FORGED = 'ok\nts=1 level=error msg="forged" \x1b[2J\x9b'


@pytest.fixture
def written(capsys):
    """Returns what was logged since the last call."""
    return lambda: capsys.readouterr().err


def test_logfmt_is_one_line_per_record_for_any_message(written):
    logs.set_up("info", "logfmt")
    LOG.warning("robot %s", FORGED)
    LOG.debug("not shown")
    text = written()
    assert text.count("\n") == 1
    assert not set(text) & set("\x1b\x9b")
    assert re.match(
        r"ts=\d{4}-\d\d-\d\dT[\d:]{8}\.\d{3}Z level=warning logger=some\.module msg=\"", text
    )


def test_json_is_one_object_per_record_with_its_error(written):
    logs.set_up("info", "json")
    LOG.error("went wrong", exc_info=ValueError(FORGED))
    record = json.loads(written())
    assert (record["level"], record["logger"], record["msg"]) == (
        "error",
        "some.module",
        "went wrong",
    )
    assert f"ValueError: {FORGED}" in record["error"]


class SlowReader(io.StringIO):
    """A stream whose reader reads on only when it is asked to."""

    def __init__(self):
        super().__init__()
        self.reads = threading.Event()

    def write(self, text: str) -> int:
        self.reads.wait(20.0)
        return super().write(text)


def test_no_message_of_a_robot_waits_for_whoever_reads_the_log(request):
    reader = SlowReader()
    logs.set_up("info", "logfmt", reader)
    listener = logs.write_aside(*LOGGED_UNDER_LOCK)
    for name in LOGGED_UNDER_LOCK:  # others look at these lines elsewhere
        (handler,) = logging.getLogger(name).handlers
        request.addfinalizer(partial(logging.getLogger(name).removeHandler, handler))
        request.addfinalizer(partial(setattr, logging.getLogger(name), "propagate", True))
    driver = StateDriver()

    array = Array(0.0, (Status(ERROR, "Motor", "x" * (2 * MAX_TEXT)),), 2 * MAX_TEXT)
    driver.state.receive(Topic(0, "/r/diagnostics"), array, driver.now)

    assert driver.level("Motor") == ERROR
    assert reader.getvalue() == ""
    reader.reads.set()
    atexit.unregister(listener.stop)
    listener.stop()
    assert "level=warning logger=ros_diagnostics_exporter.robots." in reader.getvalue()


def records_of(program: str, returncode: int = 0) -> list[dict[str, str]]:
    """The records on standard error of a program that wraps its output."""
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


def test_output_that_bypasses_the_log_becomes_records():
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


def test_the_last_lines_before_an_abort_are_kept():
    found = records_of(
        """
        logging.getLogger("own").info("first")
        os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'\\n")
        os.abort()
        """,
        -signal.SIGABRT,
    )
    assert found[-1]["msg"].startswith("terminate called")


def test_an_uncaught_exception_becomes_records():
    found = records_of("raise ValueError('nobody catches this')", 1)
    assert found[-1]["msg"] == "ValueError: nobody catches this"


def test_output_written_with_the_interpreter_lock_held_does_not_deadlock():
    found = records_of("""
        libc = ctypes.PyDLL(None)  # calls hold the lock
        for _ in range(40):
            text = b"x" * 9_999 + b"\\n"
            assert libc.write(2, text, len(text)) == len(text)
        """)
    assert sum(len(each["msg"]) for each in found) == 40 * 9_999
    assert max(len(each["msg"]) for each in found) == logs.LINE_BYTES


def test_a_signal_to_the_process_group_does_not_lose_the_last_lines():
    found = records_of("""
        signal.signal(signal.SIGTERM, lambda *_: os.write(2, b"asked to end\\n"))
        os.killpg(0, signal.SIGTERM)
        """)
    assert [each["msg"] for each in found] == ["asked to end"]
