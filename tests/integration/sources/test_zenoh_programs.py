"""The real bridge and the real router, with both configs of docs/beyond-the-lan.md over TLS."""

import json
import re
from pathlib import Path

import pytest
import trustme
from zenoh import Config

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import Status
from testbed import domains, programs, zenoh
from testbed.polling import until

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "beyond-the-lan.md").read_text()
HOT = Status(2, "Motor", "Hot")


@pytest.fixture
def files(tmp_path) -> dict[str, Path]:
    """Certificates, users and a password."""
    try:
        zenoh.program("zenohd")
    except programs.MissingProgram as error:
        pytest.skip(str(error))
    authority = trustme.CA()
    router = authority.issue_cert("localhost")
    found = {name: tmp_path / name for name in ("ca", "certificate", "key", "users", "password")}
    authority.cert_pem.write_to_path(found["ca"])
    router.cert_chain_pems[0].write_to_path(found["certificate"])
    router.private_key_pem.write_to_path(found["key"])
    found["users"].write_text("exporter:e\nagv_7:a\n")
    found["password"].write_text("e\n")
    return found


def write(path: Path, text: str, values: dict[str, object]) -> Path:
    """A config with some other values."""
    config = Config.from_json5(text)
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value if not isinstance(value, Path) else str(value)))
    path.write_text(str(config))
    return path


@pytest.fixture
def access(files, ros_domain, free_port, start_process) -> Zenoh:
    """How the exporter reaches the router that the bridge of the domain is connected to."""
    folder = files["ca"].parent
    [text] = [
        each
        for each in re.findall(r"```json5\n(.*?)```", PAGE, re.DOTALL)
        if "access_control" in each
    ]
    locator = f"tls/localhost:{free_port()}"
    of_router = {
        "listen/endpoints": [locator],
        "transport/link/tls/listen_certificate": files["certificate"],
        "transport/link/tls/listen_private_key": files["key"],
        "transport/auth/usrpwd/dictionary_file": files["users"],
        "scouting/multicast/enabled": False,
    }
    of_bridge = {
        "connect/endpoints": [locator],
        "transport/link/tls/root_ca_certificate": files["ca"],
        "transport/auth/usrpwd/password": "a",
        "plugins/ros2dds/domain": ros_domain,
        "scouting/multicast/enabled": False,
    }
    config = write(folder / "router.json5", text, of_router)
    start_process("zenohd", [zenoh.program("zenohd"), "--config", str(config)], None)
    shipped = (ROOT / "packaging" / "zenoh" / "bridge.json5").read_text()
    config = write(folder / "bridge.json5", shipped, of_bridge)
    environment = zenoh.on_loopback(domains.environment(ros_domain))
    start_process("bridge", [zenoh.program("zenoh-bridge"), str(config)], environment)
    login = {"user": "exporter", "password_file": files["password"]}
    return Zenoh((locator,), ca_file=files["ca"], **login)


def robot(name: str, namespace: str) -> Robot:
    where = {"zenoh": "customer_b/agv_7", "namespace": namespace, "source": "agg"}
    return validated(Robot, {"name": name, **where}, {"default": Profile(stale_after=5.0)})


def test_a_robot_with_tls_and_login_is_received_and_may_write_nothing_else(
    access, robots, run_exporter
):
    declared = (robot("agv_7", "/"), robot("other", "/other"))
    running = run_exporter(Fleet("f", declared, zenoh=access))
    robots.offer("/diagnostics_agg")
    robots.offer("/other/diagnostics_agg")  # which the router allows nobody to write

    def up() -> bool:
        robots.send("/diagnostics_agg", HOT)
        robots.send("/other/diagnostics_agg", HOT)
        return running.sample("robot_up", robot="agv_7") == 1

    until(up, "agv_7 is up", 90, every=0.3)
    number = running.sample("robot_messages_total", robot="agv_7")

    def more() -> bool:
        up()
        return running.sample("robot_messages_total", robot="agv_7") >= number + 3

    until(more, "more messages", 60, every=0.3)
    assert running.sample("component_level", robot="agv_7", component="Motor") == 2
    assert running.sample("robot_messages_total", robot="other") == 0
