"""A program ends when it is stopped, and with the process that started it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from testbed.polling import until

STUBBORN = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN);"
    "print('ready', flush=True); time.sleep(600)"
)


START_AN_ORPHAN = (
    "import sys; from pathlib import Path; from testbed.processes import Process;"
    "argv = [sys.executable, '-c', sys.argv[1]];"
    "process = Process('orphan', argv, None, Path(sys.argv[2])).start();"
    "process.wait_for_output('ready'); print(process.pid, flush=True); sys.stdin.read()"
)


def gone(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return True
    return state == "Z"


def test_stop_ends_the_children_too(start_process):
    process = start_process("parent", ["sh", "-c", "sleep 600 & echo child=$!; wait"])
    child = int(process.wait_for_output(r"child=(\d+)")[1])

    process.stop()

    until(lambda: gone(child), "the end of the child")


def test_the_program_dies_with_the_process_that_started_it(tmp_path):
    argv = [sys.executable, "-c", START_AN_ORPHAN, STUBBORN, str(tmp_path / "log")]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        orphan = int(parent.stdout.readline())
        assert not gone(orphan)
        os.kill(parent.pid, signal.SIGKILL)

    until(lambda: gone(orphan), "the end of the orphan")


def test_waiting_for_output_ends_with_the_program(start_process):
    process = start_process("short", ["sh", "-c", "echo no such file; exit 3"])

    with pytest.raises(RuntimeError, match=r"short ended with 3; its last output:\nno such file"):
        process.wait_for_output("never")
