"""Fast DDS is given profiles, unless the user has some."""

from __future__ import annotations

import re
from pathlib import Path

from ros_diagnostics_exporter.ingest.ros import use_profiles

VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def test_the_file_that_is_installed_is_used(tmp_path):
    environment: dict[str, str] = {}
    use_profiles(environment, tmp_path)

    text = Path(environment[VARIABLE]).read_text()
    assert re.search("<allocated_samples>1<", text)


def test_a_file_that_the_user_names_stays(tmp_path):
    environment = {VARIABLE: "/etc/dds.xml"}
    use_profiles(environment, tmp_path)

    assert environment == {VARIABLE: "/etc/dds.xml"}


def test_the_user_s_file_in_the_working_directory_stays(tmp_path):
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").touch()
    environment: dict[str, str] = {}
    use_profiles(environment, tmp_path)

    assert not environment
