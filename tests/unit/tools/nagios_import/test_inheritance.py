"""Templates are filled in as in Nagios: the examples of its chapter on object inheritance."""

import pytest

from ros_diagnostics_tools.nagios.importer.files import NagiosError, read
from ros_diagnostics_tools.nagios.importer.inheritance import Templates
from ros_diagnostics_tools.nagios.importer.ledger import ImportLedger


def things(tmp_path, *definitions: str):
    path = tmp_path / "objects.cfg"
    path.write_text("".join(f"define host {{\n{each}\n}}\n" for each in definitions))
    templates = Templates(read([path]).definitions, ImportLedger())
    return {thing.get("host_name"): thing for thing in templates.things()}


def test_own_values_hide_inherited_ones_and_templates_are_no_objects(tmp_path):
    found = things(
        tmp_path,
        "host_name h1\ncheck_command a\nmax_check_attempts 5\nname t1",
        "host_name h2\nmax_check_attempts 3\nuse t1",
        "name t2\nregister 0\ncheck_interval 9",
    )

    assert set(found) == {"h1", "h2"}
    assert (found["h2"].get("check_command"), found["h2"].get("max_check_attempts")) == ("a", "3")
    assert "name" not in found["h2"].values


def test_of_several_templates_the_first_that_has_a_value_counts(tmp_path):
    found = things(
        tmp_path,
        "name t1\nactive_checks_enabled 1\ncheck_interval 10\nregister 0",
        "name t2\nactive_checks_enabled 0\nretry_interval 15\nuse t3\nregister 0",
        "name t3\nnotification_options d,u\ncheck_interval 99\nregister 0",
        "host_name h\nuse t1, t2",
    )["h"]

    values = [
        found.get(key) for key in ("active_checks_enabled", "check_interval", "retry_interval")
    ]
    assert values == ["1", "10", "15"]
    assert found.get("notification_options") == "d,u"


def test_null_ends_inheritance_and_plus_adds(tmp_path):
    found = things(
        tmp_path,
        "name top\nhostgroups all\nevent_handler run\nregister 0",
        "name middle\nhostgroups +linux\nuse top\nregister 0",
        "host_name h\nhostgroups +web\nevent_handler null\naddress +not-a-list\nuse middle",
        "host_name other\nhostgroups own\nuse middle",
        "host_name none\nhostgroups null\nuse middle",
    )

    assert found["h"].list("hostgroups") == ["all", "linux", "web"]
    assert found["h"].get("event_handler") == ""
    assert found["h"].get("address") == "+not-a-list"
    assert found["other"].list("hostgroups") == ["own"]
    assert found["none"].list("hostgroups") == []
    assert [each.line for each in found["h"].lines("hostgroups")] == [3, 9, 15]


@pytest.mark.parametrize(
    ("definitions", "message"),
    [
        (("host_name h\nuse nowhere",), "use nowhere: there is no host template of this name"),
        (("name a\nuse b\nhost_name h", "name b\nuse a\nregister 0"), "use runs in a circle"),
    ],
)
def test_a_template_that_does_not_work_is_an_error(tmp_path, definitions, message):
    with pytest.raises(NagiosError, match=message):
        things(tmp_path, *definitions)
