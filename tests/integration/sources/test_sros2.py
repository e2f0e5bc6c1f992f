"""The exporter's policy for SROS 2, enforced: by Debian's Cyclone DDS, with a real keystore.

The wheels of ROS have no DDS security compiled in, so that the participant is none of rclpy's; what
decides are the files of the enclave, which are the same for all middlewares.
"""

import ctypes
import datetime as dt
import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from support import secured_participant
from support.cyclone_robot import CONFIG, CONFIG_VARIABLE
from support.keystore import Keystore

CHECKOUT = Path(__file__).parents[3]
POLICY = CHECKOUT / "packaging/sros2/policy.xml"
# As `ros2 security create_permission` of sros2 0.13 makes it of the policy.
PERMISSIONS = CHECKOUT / "tests/data/sros2/permissions.xml"
READ = (
    *("rt/r/diagnostics", "rt/hall/r_2/diagnostics_agg", "rt/diagnostics"),
    *("rt/rosout", "rt/parameter_events", "rt/r/amcl/transition_event", "rt/r/battery_state"),
    *("rt/r/dock_robot/_action/status", "rt/battery_state"),
)
OTHERS = ("rt/cmd_vel", "rt/r/cmd_vel", "rt/r/scan", "rq/r/amcl/set_parametersRequest")
DISCOVERY = "ros_discovery_info"


@pytest.fixture
def run_participants(request, tmp_path, ros_domain, dds_environment, start_process):
    """A function (permissions of the guest): what the guest can do."""
    try:
        ctypes.CDLL(secured_participant.LIBRARY)
    except OSError:
        why = "needs Debian's libddsc0debian, which ./run test --all installs"
        (pytest.fail if request.config.getoption("--all") else pytest.skip)(why)
    keystore = Keystore(tmp_path, ros_domain)

    def start(what: str, enclave: str, permissions: str, *topics: str):
        files = keystore.add_enclave(enclave, _permissions(ros_domain, enclave, permissions))
        script = [sys.executable, secured_participant.__file__, what, str(ros_domain), str(files)]
        env = dds_environment | {CONFIG_VARIABLE: CONFIG}
        return start_process(enclave.lstrip("/"), [*script, *topics], env)

    def run(permissions: str) -> dict[str, object]:
        start("offer", "/robot", _all_allowed(), READ[0]).wait_for_output("offered", 60)
        guest = start("try", "/monitor", permissions, *READ, *OTHERS, DISCOVERY)
        return json.loads(guest.wait_for_output("{.*}", 90)[0])

    return run


def _permissions(domain_id: int, enclave: str, text: str) -> str:
    """For a domain and an identity, valid today."""
    day, today = dt.timedelta(days=1), dt.datetime.now(dt.timezone.utc)
    times = {"not_before": today - day, "not_after": today + day}
    for name, at in times.items():
        text = re.sub(f"(<{name}>)[^<]*", rf"\g<1>{at:%Y-%m-%dT%H:%M:%S}", text)
    text = text.replace("<id>0</id>", f"<id>{domain_id}</id>")
    return text.replace("CN=/monitor", f"CN={enclave}")


def _all_allowed() -> str:
    return PERMISSIONS.read_text().replace("<default>DENY", "<default>ALLOW")


def test_the_policy_compiles_to_the_permissions_that_are_tested():
    policy = ET.parse(POLICY)
    [topics] = policy.iter("topics")
    assert topics.attrib == {"subscribe": "ALLOW"}
    permissions = ET.parse(PERMISSIONS)
    read, published_and_read = permissions.iter("allow_rule")
    assert [each.text for each in read.iter("topic")] == [f"rt{each.text}" for each in topics]
    assert read.find("publish") is None
    assert {each.text for each in published_and_read.iter("topic")} == {DISCOVERY}
    assert [each.text for each in permissions.iter("default")] == ["DENY"]


def test_under_the_policy_what_is_named_is_read_and_nothing_is_written(run_participants):
    found = run_participants(PERMISSIONS.read_text())
    assert found == {"matched": 1, "reads": [*READ, DISCOVERY], "writes": [DISCOVERY]}


def test_without_the_policy_the_same_participant_could_drive_a_robot(run_participants):
    found = run_participants(_all_allowed())
    assert found["writes"] == [*READ, *OTHERS, DISCOVERY]
