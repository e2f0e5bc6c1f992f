"""exporter/package.xml and setup.py, for colcon and bloom, say what pyproject.toml says."""

import re
import tempfile
import xml.etree.ElementTree as ET
from configparser import ConfigParser
from pathlib import Path

import ros_diagnostics_exporter
from ros_diagnostics_exporter.cli import flags
from ros_diagnostics_exporter.config.load import load
from support import launching
from testbed.configuration import CHECKOUT

PROJECT = (CHECKOUT / "pyproject.toml").read_text()
LAUNCH_FILE = CHECKOUT / "exporter" / "ros_launch" / "exporter.launch.py"
PACKAGE = ET.parse(CHECKOUT / "exporter" / "package.xml").getroot()


def test_name_version_and_licence_are_the_same():
    assert PACKAGE.findtext("name") == ros_diagnostics_exporter.__name__
    assert PACKAGE.findtext("version") == ros_diagnostics_exporter.__version__
    assert f'license = "{PACKAGE.findtext("license")}"' in PROJECT


def test_commands_run_by_the_python_of_an_active_environment():
    settings = ConfigParser()
    settings.read(CHECKOUT / "exporter" / "setup.cfg")
    assert settings["build_scripts"]["executable"] == "/usr/bin/env python3"


def test_the_commands_are_the_same():
    ours = re.findall(r'^(\S+) = "(ros_diagnostics_\S+)"$', PROJECT, re.MULTILINE)
    setup = (CHECKOUT / "exporter" / "setup.py").read_text()
    packages = {"NAME": "ros_diagnostics_exporter", "TOOLS": "ros_diagnostics_tools"}
    found = re.findall(r'f"(\S+) = \{(\w+)\}(\S+)"', setup)
    theirs = [(command, packages[package] + path) for command, package, path in found]
    assert sorted(theirs) == sorted(ours)


def launch(monkeypatch, **chosen):
    """The program that the launch file starts, with its flags as the exporter reads them."""
    found = launching.run(LAUNCH_FILE, monkeypatch)
    (program,) = found.exporter({"config": "", "domain": "0", "respawn": "true", **chosen})
    *declared, _ = found.generate_launch_description().arguments[0]
    assert {each.arguments[0] for each in declared} == {"config", "domain", "respawn"}
    assert program.options["package"] == PACKAGE.findtext("name")
    assert f"{program.options['executable']} = " in PROJECT
    return program, flags.parse(program.options["arguments"])


def test_the_launch_file_starts_the_exporter_and_starts_it_again(monkeypatch):
    program, options = launch(monkeypatch, config="/etc/fleet.yml")
    assert options.config_file == Path("/etc/fleet.yml")
    assert (program.options["respawn"], program.options["respawn_delay"]) == (True, 5.0)

    once, _ = launch(monkeypatch, config="/etc/fleet.yml", respawn="false")
    assert not once.options["respawn"]


def test_launched_without_a_config_it_receives_every_robot_of_a_domain(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    _, options = launch(monkeypatch, domain="7")
    (discovery,) = load(options.config_file).discoveries

    assert (discovery.template, discovery.domain_ids) == ("/{robot}/diagnostics_agg", (7,))


def test_the_launch_file_is_installed():
    setup = (CHECKOUT / "exporter" / "setup.py").read_text()
    assert f'(f"share/{{NAME}}/launch", ["ros_launch/{LAUNCH_FILE.name}"])' in setup
