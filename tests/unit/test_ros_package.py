"""exporter/package.xml and setup.py, for colcon and bloom, say what pyproject.toml says."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from configparser import ConfigParser

import ros_diagnostics_exporter
from testbed.configuration import CHECKOUT

PROJECT = (CHECKOUT / "pyproject.toml").read_text()
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
