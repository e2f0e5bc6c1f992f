"""`./run` as a person starts it, on a machine of which only the programs that it calls are feigned.

The shell text is the shipped one, but for /usr/sbin, in whose place stands a folder of the test's.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
ORIGINAL = "#!/bin/sh\n# the administrator's\nexit 104\n"
MARK = "# ./run installs: "
BASICS = (
    *("bash", "basename", "cat", "cksum", "dirname", "flock", "grep", "head", "mkdir", "sed", "sh"),
    *("sort", "touch", "uname", "wc"),
)
CHANGING = ("chmod", "cp", "mv", "rm")  # killed there, the installer leaves something half done
# What a feigned program does: it notes its call, and at its turn ends whoever runs the installer.
FEIGNED = r"""#!/bin/sh
name=${0##*/}
echo "$name $*" >>FOLDER/calls
"""
KILLING = r"""
if [ "$(wc -l <FOLDER/calls)" = "${KILL_AT:-}" ]; then kill -KILL "$(cat FOLDER/pid)"; exit 1; fi
"""
# `python3 -m venv` makes an environment whose Python notes its calls; the rest is the real one's.
PYTHON = r"""#!/bin/sh
if [ "$1 $2" != "-m venv" ]; then exec REAL "$@"; fi
for folder; do :; done
mkdir -p "$folder/bin"
cat >"$folder/bin/python" <<'END'
#!/bin/sh
case "$*" in
*grafana_foundation_sdk*) exit 1 ;;
--version) echo "Python 3.10.13" ;;
*) echo "python $*" >>FOLDER/calls ;;
esac
END
chmod +x "$folder/bin/python"
"""


class Machine:
    """A checkout, a folder of programs that is all of PATH, and a policy-rc.d."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.policy = folder / "sbin" / "policy-rc.d"
        self.checkout = folder / "checkout"
        for each in ("bin", "sbin", "checkout/packaging", "checkout/tests/bench"):
            (folder / each).mkdir(parents=True)
        for name in ("run", "pyproject.toml", "packaging/install-packages"):
            text = (CHECKOUT / name).read_text()
            # Nothing here may touch the machine itself.
            text = text.replace("/usr/sbin/", f"{self.policy.parent}/")
            (self.checkout / name).write_text(text)
        (self.checkout / "tests/bench/rules.py").write_text("if __name__ == '__main__': ...\n")
        for name in BASICS:
            self.program(name, f'#!/bin/sh\nexec {shutil.which(name)} "$@"\n')
        for name in CHANGING:
            self.program(name, FEIGNED + KILLING + f'exec {shutil.which(name)} "$@"\n')
        for name in ("apt-get", "dpkg", "update-rc.d", "systemctl"):
            self.program(name, FEIGNED + KILLING + f"cat {self.policy} >>FOLDER/policies\n")
        self.program("dpkg", FEIGNED + KILLING + 'case $1 in -L) echo "/etc/init.d/$2" ;; esac\n')
        self.program("sudo", '#!/bin/sh\nif [ "$1" = --non-interactive ]; then shift; fi\n"$@"\n')
        self.program("python3", PYTHON.replace("REAL", sys.executable))

    def program(self, name: str, text: str) -> None:
        path = self.folder / "bin" / name
        path.write_text(text.replace("FOLDER", str(self.folder)))
        path.chmod(0o755)

    def call(self, *argv: str | Path, kill_at: int = 0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", "-c", f'echo $$ >{self.folder}/pid; exec "$@"', "sh", *argv],
            env={"PATH": str(self.folder / "bin"), "KILL_AT": str(kill_at)},
            cwd=self.checkout,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )

    def run(self, *verb: str) -> subprocess.CompletedProcess[str]:
        return self.call("bash", self.checkout / "run", *verb)

    def install(self, *packages: str, kill_at: int = 0) -> int:
        (self.folder / "calls").unlink(missing_ok=True)
        script = self.checkout / "packaging" / "install-packages"
        return self.call("sh", script, *packages, kill_at=kill_at).returncode

    def calls(self) -> list[str]:
        path = self.folder / "calls"
        return path.read_text().splitlines() if path.exists() else []

    def installed(self) -> list[str]:
        """The packages of the last apt-get install."""
        lines = [call for call in self.calls() if call.startswith("apt-get install")]
        return [word for word in lines[-1].split()[2:] if re.fullmatch("[a-z][a-z-]+", word)]


@pytest.fixture
def machine(tmp_path) -> Machine:
    return Machine(tmp_path)


@pytest.fixture(params=[None, ORIGINAL], ids=["no policy", "a policy"])
def original(request, machine) -> str | None:
    """What the administrator has in policy-rc.d."""
    if request.param is not None:
        machine.policy.write_text(request.param)
        machine.policy.chmod(0o755)
    return request.param


def now(machine: Machine) -> str | None:
    return machine.policy.read_text() if machine.policy.exists() else None


def test_no_service_starts_now_or_at_the_next_boot(machine, original):
    assert machine.install("one", "two") == 0

    policies = (machine.folder / "policies").read_text()
    assert MARK + "one two" in policies
    assert "exit 101" in policies
    assert "exit 104" not in policies
    assert "update-rc.d one disable" in machine.calls()
    assert now(machine) == original
    assert [path.name for path in machine.policy.parent.iterdir()] == (
        ["policy-rc.d"] if original else []
    )


def test_killed_at_any_moment_it_neither_loses_the_policy_nor_leaves_its_own(machine, original):
    moments = 0
    while machine.install("one", kill_at=moments + 1) == -signal.SIGKILL:
        moments += 1
        left = machine.call("sh", machine.checkout / "packaging/install-packages", "--interrupted")
        assert left.returncode == 0, left.stderr
        assert left.stdout == ("one\n" if MARK in (now(machine) or "") else "")

        assert machine.install("two") == 0

        assert machine.installed() == (["one", "two"] if left.stdout else ["two"])
        assert now(machine) == original
        if original:
            assert os.access(machine.policy, os.X_OK)
    assert moments >= 8  # each change of a file, and each call of apt and its like
    assert now(machine) == original


def test_it_can_be_killed_again_and_again(machine, original):
    for moment in (6, 4, 7, 5, 6):
        assert machine.install("one", kill_at=moment) == -signal.SIGKILL
    assert machine.install("one") == 0
    assert now(machine) == original


def test_an_interrupted_installation_is_finished_though_nothing_is_missing_any_more(
    machine, original
):
    while MARK not in (now(machine) or ""):
        assert machine.install("prometheus", kill_at=len(machine.calls()) + 1)
    for name in ("prometheus", "promtool", "prometheus-alertmanager", "amtool"):
        machine.program(name, "#!/bin/sh\n")
    (machine.folder / "calls").unlink()

    done = machine.run("bench", "rules")

    assert done.returncode == 0, done.stderr
    assert machine.installed() == ["prometheus"]
    assert now(machine) == original


def test_a_bench_has_the_servers_installed_and_then_runs(machine):
    done = machine.run("bench", "rules")

    assert done.returncode == 0, done.stderr
    assert machine.installed() == ["prometheus", "prometheus-alertmanager"]
    assert machine.calls()[-1] == "python -m bench.rules"


def test_without_the_dashboards_sdk_one_sentence_says_what_is_wanted(machine):
    done = machine.run("dashboards")

    assert done.returncode == 1
    (sentence,) = done.stderr.splitlines()
    assert "the dashboards' SDK needs Python 3.11 or newer, and this is Python 3.10.13" in sentence
    assert not [call for call in machine.calls() if "fleet_dashboards" in call]
