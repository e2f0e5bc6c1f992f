"""`./run` on a fake machine: the programs that it calls are fakes that note their calls.

The scripts are the shipped ones, with a temporary folder in place of /usr/sbin.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.called import called

CHECKOUT = Path(__file__).parents[2]
ORIGINAL = "#!/bin/sh\n# the administrator's\nexit 104\n"
MARK = "# ./run installs: "
BASICS = (
    *("bash", "basename", "cat", "cksum", "date", "dirname", "du", "find", "flock", "grep", "head"),
    *("ln", "mkdir", "sed", "sh", "sha256sum", "sleep", "sort", "touch", "uname", "wc"),
)
CHANGING = ("chmod", "cp", "mv", "rm")  # where a killed installer leaves something unfinished
# A fake program notes its call.
FAKE = r"""#!/bin/sh
name=${0##*/}
echo "$name $*" >>FOLDER/calls
"""
# Kills the installer at the call whose number is in KILL_AT.
KILL = r"""
if [ "$(wc -l <FOLDER/calls)" = "${KILL_AT:-}" ]; then kill -KILL "$(cat FOLDER/pid)"; exit 1; fi
"""
# `python3 -m venv` makes an environment of fakes; any other call goes to the real Python.
PYTHON = r"""#!/bin/sh
if [ "$1 $2" != "-m venv" ]; then exec REAL "$@"; fi
for folder; do :; done
mkdir -p "$folder/bin"
cat >"$folder/bin/python" <<'END'
#!/bin/sh
case "$*" in
*grafana_foundation_sdk*) exit 1 ;;
--version) echo "Python 3.10.13" ;;
*)
    echo "python $*" >>FOLDER/calls
    case "$*" in *"pip install"*) if [ -e FOLDER/offline ]; then
        cat FOLDER/offline >&2
        exit 1
    fi ;; esac
    ;;
esac
END
for name in ruff mypy; do
    printf '#!/bin/sh\necho "%s $*" >>FOLDER/calls\n' "$name" >"$folder/bin/$name"
done
chmod +x "$folder/bin/python" "$folder/bin/ruff" "$folder/bin/mypy"
"""


class Machine:
    """A checkout, a folder of programs that is all of PATH, and a policy-rc.d."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.policy = folder / "sbin" / "policy-rc.d"
        self.checkout = folder / "checkout"
        self.path = str(folder / "bin")
        for each in ("bin", "sbin", "checkout/packaging/locks", "checkout/lab/bench"):
            (folder / each).mkdir(parents=True)
        for name in ("run", "pyproject.toml", "packaging/install-packages", "packaging/progress"):
            text = (CHECKOUT / name).read_text()
            # Nothing here may touch the machine itself.
            text = text.replace("/usr/sbin/", f"{self.policy.parent}/")
            (self.checkout / name).write_text(text)
            shutil.copymode(CHECKOUT / name, self.checkout / name)
        for lock in ("versions", "build", "demo"):
            (self.checkout / f"packaging/locks/{lock}.txt").write_text("one==1\n")
        (self.checkout / "lab/bench/rules.py").write_text("if __name__ == '__main__': ...\n")
        for name in BASICS:
            self.program(name, f'#!/bin/sh\nexec {shutil.which(name)} "$@"\n')
        for name in CHANGING:
            self.program(name, FAKE + KILL + f'exec {shutil.which(name)} "$@"\n')
        for name in ("apt-get", "dpkg", "update-rc.d", "systemctl"):
            self.program(name, FAKE + KILL + f"cat {self.policy} >>FOLDER/policies\n")
        self.program("dpkg", FAKE + KILL + 'case $1 in -L) echo "/etc/init.d/$2" ;; esac\n')
        self.program("sudo", '#!/bin/sh\nif [ "$1" = --non-interactive ]; then shift; fi\n"$@"\n')
        self.program("python3", PYTHON.replace("REAL", sys.executable))

    def program(self, name: str, text: str) -> None:
        path = self.folder / "bin" / name
        path.write_text(text.replace("FOLDER", str(self.folder)))
        path.chmod(0o755)

    def call(
        self, *argv: str | Path, code: int | None = 0, kill_at: int = 0
    ) -> subprocess.CompletedProcess[str]:
        return called(
            ["sh", "-c", f'echo $$ >{self.folder}/pid; exec "$@"', "sh", *argv],
            env={"PATH": self.path, "HOME": str(self.folder), "KILL_AT": str(kill_at)},
            code=code,
            cwd=self.checkout,
            stdin=subprocess.DEVNULL,
            timeout=120,
        )

    def run(self, *verb: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        """What `./run` says; it must end with this exit code."""
        return self.call("bash", self.checkout / "run", *verb, code=code)

    def install(self, *packages: str, kill_at: int = 0) -> int:
        (self.folder / "calls").unlink(missing_ok=True)
        script = self.checkout / "packaging" / "install-packages"
        return self.call("sh", script, *packages, code=None, kill_at=kill_at).returncode

    def pip(self) -> list[str]:
        """What pip was told to install, by each call."""
        calls = (call.partition("-m pip install --quiet --no-compile ") for call in self.calls())
        return [arguments for _, found, arguments in calls if found]

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
    assert not [call for call in machine.calls() if call.startswith("dpkg --configure")]
    assert now(machine) == original
    assert [path.name for path in machine.policy.parent.iterdir()] == (
        ["policy-rc.d"] if original else []
    )


def test_killed_at_any_moment_the_next_run_restores_the_policy(machine, original):
    moments = 0
    while machine.install("one", kill_at=moments + 1) == -signal.SIGKILL:
        moments += 1
        left = machine.call("sh", machine.checkout / "packaging/install-packages", "--interrupted")
        assert left.stdout == ("one\n" if MARK in (now(machine) or "") else "")

        assert machine.install("two") == 0

        assert machine.installed() == (["one", "two"] if left.stdout else ["two"])
        assert ("dpkg --configure -a" in machine.calls()) == bool(left.stdout)
        assert now(machine) == original
        if original:
            assert os.access(machine.policy, os.X_OK)
    assert moments >= 8  # each change of a file, and each call of apt and its like
    assert now(machine) == original


def test_installing_after_several_kills_restores_the_policy(machine, original):
    for moment in (6, 4, 7, 5, 6):
        assert machine.install("one", kill_at=moment) == -signal.SIGKILL
    assert machine.install("one") == 0
    assert now(machine) == original


def test_an_interrupted_installation_is_finished_even_if_nothing_is_missing_now(machine, original):
    while MARK not in (now(machine) or ""):
        assert machine.install("prometheus", kill_at=len(machine.calls()) + 1)
    for name in ("prometheus", "promtool", "prometheus-alertmanager", "amtool"):
        machine.program(name, "#!/bin/sh\n")
    (machine.folder / "calls").unlink()

    machine.run("bench", "rules")

    assert machine.installed() == ["prometheus"]
    assert now(machine) == original


def test_bench_installs_the_servers_and_runs(machine):
    machine.run("bench", "rules")

    assert machine.installed() == ["prometheus", "prometheus-alertmanager"]
    assert machine.calls()[-1] == "python -m bench.rules"


def test_a_verb_installs_the_packages_that_it_needs_once(machine):
    own = "--no-build-isolation --editable"
    versions = "--constraint packaging/locks/versions.txt"
    project = [
        "--require-hashes --requirement packaging/locks/build.txt",
        "--require-hashes --requirement packaging/locks/demo.txt",
        f"{versions} {own} .[ros,demo]",
        f"--no-deps {own} ./sim",
    ]
    test = "--group test --group dashboards --group docs"
    tools = [f"{versions} {test}", f"{versions} --group mutation"]

    machine.run("demo")
    assert machine.pip() == project
    machine.run("mutate")
    assert machine.pip() == [*project, *tools]
    machine.run("mutate")
    assert machine.pip() == [*project, *tools]

    with (machine.checkout / "pyproject.toml").open("a") as file:
        file.write("# another version\n")
    machine.run("mutate")
    assert machine.pip() == [*project, *tools, *project, *tools]

    with (machine.checkout / "packaging/locks/versions.txt").open("a") as file:
        file.write("two==2\n")
    machine.run("demo")
    assert machine.pip() == [*project, *tools, *project, *tools, *project]


def test_each_library_is_there_once_and_headers_are_not(machine):
    machine.run("demo")
    environment = machine.checkout / ".venv"
    (environment / "include" / "fastdds").mkdir(parents=True)
    packages = environment / "lib" / "python3.11" / "site-packages"
    for name in ("one.libs", "two.libs", "zstandard"):
        (packages / name).mkdir(parents=True)
    library, *same = (
        *(environment / "lib" / name for name in ("liba.so", "liba.so.2", "liba.so.2.1")),
        *(packages / name / "liba-1.so.2" for name in ("one.libs", "two.libs")),
    )
    for file in (library, *same, packages / "one.py", packages / "two.py"):
        file.write_text("a")
    library.with_name("liba.so.3").write_text("b")
    unused = packages / "zstandard" / "_cffi.cpython-311-x86_64-linux-gnu.so"
    unused.write_text("c")
    with (machine.checkout / "pyproject.toml").open("a") as pyproject:
        pyproject.write("# so everything is installed once more\n")

    for _ in range(2):
        machine.run("demo")

        assert all(library.samefile(file) for file in same)
        assert library.stat().st_nlink == 5
        assert library.with_name("liba.so.3").read_text() == "b"
        assert not (environment / "include").exists()
        assert not unused.exists()


def test_each_installation_says_what_it_installs(machine):
    said = machine.run("demo").stdout

    assert re.findall(r"^installing .*", said, re.MULTILINE) == [
        "installing once: what builds the packages, 1 packages ...",
        "installing once: ROS 2 and what the demo needs, 1 packages ...",
        "installing once: the exporter ...",
        "installing once: the virtual robots ...",
        "installing from the distribution: prometheus prometheus-alertmanager ...",
    ]


def test_what_takes_long_gives_signs_of_life_and_ends_as_its_command(tmp_path):
    """The command ends once a sign was seen, so the test waits for no time."""
    said = tmp_path / "said"
    command = f"until grep -q ' s, [0-9]* MB by now' {said}; do :; done; exit 3"
    argv = [CHECKOUT / "packaging" / "progress", "ROS 2", tmp_path, "sh", "-c", command]
    with said.open("w") as output:
        done = subprocess.run(
            argv,
            env=os.environ | {"PROGRESS_SECONDS": "0.05"},
            stdout=output,
            check=False,
            timeout=60,
        )

    first, second, *_ = said.read_text().splitlines()
    assert done.returncode == 3
    assert first == "ROS 2 ..."
    assert re.fullmatch(r"  ROS 2: \d+ s, \d+ MB by now", second)


def test_in_a_shell_where_the_environment_is_active_it_is_not_made_anew(machine):
    machine.run("demo")
    active = machine.checkout / ".venv" / "bin"
    (active / "python3").write_text(f"#!/bin/sh\necho taken >>{machine.folder}/calls\nexit 1\n")
    (active / "python3").chmod(0o755)
    before, machine.path = machine.pip(), f"{active}:{machine.path}"

    machine.run("demo")

    assert machine.pip() == before
    assert "taken" not in machine.calls()


def test_what_was_not_installed_completely_is_installed_by_the_next_run(machine):
    machine.run("demo")
    (machine.folder / "offline").write_text("ERROR: the disk is full\n")

    assert "ERROR: the disk is full" in machine.run("mutate", code=1).stderr
    (machine.folder / "offline").unlink()
    machine.run("mutate")
    *_, failed, repeated, other = machine.pip()
    assert failed == repeated != other


def test_without_a_network_the_first_run_says_so_in_one_sentence(machine):
    retry = "WARNING: Retrying (Retry(total=4)) after connection broken by 'NewConnectionError'\n"
    (machine.folder / "offline").write_text(5 * retry + "ERROR: No matching distribution found\n")

    said = machine.run("demo", code=1).stderr

    assert said.count("\n") == 1
    assert "package index does not answer" in said


@pytest.mark.parametrize("verb", ["demo", "test", "generate"])
def test_the_help_of_a_verb_installs_nothing(machine, verb):
    assert machine.run(verb, "--help").stdout.splitlines()[1].startswith(f"  {verb} ")
    assert machine.calls() == []


@pytest.mark.parametrize("verb", ["lint", "lock", "release"])
def test_the_help_of_a_verb_starts_nothing_where_it_is_set_up(machine, verb):
    for script in ("packaging/release", ".venv/bin/uv", ".venv/bin/python"):
        path = machine.checkout / script
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\necho "$0 $*" >>{machine.folder}/calls\n')
        path.chmod(0o755)
    for group in ("simulator", verb):
        (machine.checkout / ".venv" / f".installed-{group}").touch()

    assert machine.run(verb, "--help").stdout.splitlines()[1].startswith(f"  {verb} ")
    assert machine.calls() == []


def with_bridge(machine: Machine, *, built: bool) -> None:
    folder = machine.checkout / "sim" / "zenoh_bridge"
    folder.mkdir(parents=True)
    script = folder / "build-zenoh"
    script.write_text(
        f'#!/bin/sh\necho "build-zenoh $*" >>{machine.folder}/calls\nexit {0 if built else 1}\n'
    )
    script.chmod(0o755)


def test_the_demo_through_zenoh_without_cargo_says_what_to_install(machine):
    with_bridge(machine, built=False)

    said = machine.run("demo", "--zenoh", code=1).stderr

    assert "install Rust (https://rustup.rs)" in said
    assert "build-zenoh " not in machine.calls()
    assert machine.pip()[-1] == (
        "--constraint packaging/locks/versions.txt --no-build-isolation --editable .[zenoh]"
    )


def test_the_demo_through_zenoh_builds_the_bridge_unless_it_is_built(machine):
    with_bridge(machine, built=False)
    for name in ("cargo", "cmake", "cc"):
        machine.program(name, "#!/bin/sh\n")

    machine.run("demo", "--zenoh", code=1)  # this script builds nothing
    assert "build-zenoh " in machine.calls()

    (machine.folder / "calls").unlink()
    shutil.rmtree(machine.checkout / "sim")
    with_bridge(machine, built=True)
    machine.run("demo", "--zenoh")
    assert "build-zenoh " not in machine.calls()
    assert machine.calls()[-1] == "python -m demo --zenoh"


def test_the_nightly_runs_prometheus_3_and_each_python_and_says_which_is_not_there(machine):
    machine.program("chromium", FAKE)
    modules = "printf 'go: downloading a\\ngo: no space\\n' >&2\n"
    machine.program("go", f"""{FAKE}{modules}echo '\t"Dir": "FOLDER",'\n""")
    machine.program("python3.12", PYTHON.replace("REAL", sys.executable))
    machine.program("python3.13", "#!/bin/sh\nexit 127\n")  # pyenv's, of a version not chosen
    zenoh = machine.checkout / "sim/zenoh_bridge/build-zenoh"
    zenoh.parent.mkdir(parents=True)
    zenoh.symlink_to("/bin/true")
    machine.program("part", '#!/bin/sh\necho "part $* $RUN_VENV" >>FOLDER/calls\n')
    run = machine.checkout / "run"
    run.write_text(run.read_text().replace(" ./run ", " part "))

    said = machine.run("nightly").stderr

    assert "go: downloading" not in said
    assert "go: no space" in said
    module = "github.com/prometheus/prometheus@v0.311.3"
    assert f"go mod download -json {module}" in machine.calls()
    (build,) = (call for call in machine.calls() if call.startswith("go build"))
    assert "Version=3.11.3 " in build
    assert build.endswith("prometheus-v0.311.3/ ./cmd/promtool ./cmd/prometheus")
    assert any("install" in call and "lintian" in call for call in machine.calls())
    assert [call.strip() for call in machine.calls() if call.startswith("part ")] == [
        "part lint",
        "part generate --check",
        "part test --all --no-skips",
        "part bench notify --rounds 3",
        "part mutate --report survivors.txt",
        "part test tests/unit/rules tests/unit/grafana",
        "part test tests/unit tests/integration .venv-python3.12",
        "part test tests/unit/sources tests/integration/sources .venv-kilted",
    ]
    lines = [line for line in said.splitlines() if line.startswith("nightly: not run with")]
    assert [line.split()[5].rstrip(",") for line in lines] == ["3.10", "3.11", "3.13"]


def test_the_commands_of_contributing_set_up_what_they_need():
    """A verb of ./run installs what it uses; a program of .venv need not be there yet."""
    section = (CHECKOUT / "CONTRIBUTING.md").read_text().partition("## Set up and test")[2]
    commands = section.partition("```sh\n")[2].partition("```")[0].splitlines()

    assert commands
    assert [line for line in commands if not line.startswith("./run ")] == []
    for path in re.findall(r"tests/\S+", "\n".join(commands)):
        assert (CHECKOUT / path).exists()
