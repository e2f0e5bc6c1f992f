"""Nagios' files are read as Nagios reads them."""

import pytest

from ros_diagnostics_tools.nagios.importer import plugin
from ros_diagnostics_tools.nagios.importer.files import NagiosError, read


def objects(tmp_path, text: str):
    path = tmp_path / "objects.cfg"
    path.write_text(text)
    return read([path]).definitions


def test_comments_continued_lines_and_aliases(tmp_path):
    (found,) = objects(
        tmp_path,
        "# a comment\n; another\ndefine service{\n"
        "  hosts\tr1 ; its robot\n  description  motors\\; front\n"
        "  check_command check_ros!\\\n      Motor\n  normal_check_interval 5\n}\n",
    )

    assert [(each.line, each.key, each.value) for each in found.directives] == [
        (4, "host_name", "r1"),
        (5, "service_description", "motors; front"),
        (6, "check_command", "check_ros!Motor"),
        (8, "check_interval", "5"),
    ]
    assert found.directives[0].written == "hosts"
    assert found.directives[0].owner == "r1/motors; front"


def test_of_a_directive_that_is_given_twice_the_last_counts(tmp_path):
    (found,) = objects(tmp_path, "define host {\nuse a\nuse b\n}\n")
    assert (found.value("use"), found.value("name")) == ("b", "")


@pytest.mark.parametrize("line", ["check_ros -H r1 -N motor", "check_ros -Hr1 -Nmotor"])
def test_an_argument_of_a_plugin_may_follow_its_letter_at_once(line):
    found = plugin.parse(line)
    assert (found.host, found.words, found.rest) == ("r1", "motor", ())


def test_a_timeperiods_line_is_split_before_its_hours(tmp_path):
    (found,) = objects(
        tmp_path,
        "define timeperiod {\ntimeperiod_name w\nmonday 1 september - friday 2 september  "
        "08:00-12:00, 13:00-17:00\n}\n",
    )

    assert found.directives[1].key == "monday 1 september - friday 2 september"
    assert found.directives[1].value == "08:00-12:00, 13:00-17:00"


def test_a_main_file_includes_files_folders_and_resources(tmp_path):
    (tmp_path / "hosts" / "hall").mkdir(parents=True)
    (tmp_path / "hosts" / "hall" / "a.cfg").write_text("define host {\nhost_name a\n}\n")
    (tmp_path / "hosts" / "b.cfg").write_text("define host {\nhost_name b\n}\n")
    (tmp_path / "hosts" / "c.cfg.old").write_text("define host {\nhost_name c\n}\n")
    (tmp_path / "more.cfg").write_text("define host {\nhost_name d\n}\n")
    (tmp_path / "resource.cfg").write_text("$USER1$=/plugins\n")
    (tmp_path / "nagios.cfg").write_text(
        "cfg_dir=hosts\ncfg_file=more.cfg\ncfg_file=more.cfg\nresource_file=resource.cfg\n"
    )

    found = read([tmp_path / "nagios.cfg"])

    assert [each.value("host_name") for each in found.definitions] == ["b", "a", "d"]
    assert [(each.kind, each.key) for each in found.settings][-1] == ("resource", "$USER1$")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("define robot {\n}\n", ":1: robot is not an object of Nagios"),
        ("define host {\nhost_name a\n", ":1: host has no closing }"),
        ("define host {\ndefine host {\n", ":2: host of line 1 has no }"),
        ("define host {\n}\nhost_name a\n", ":3: 'host_name a' is outside of any definition"),
    ],
)
def test_what_nagios_rejects_is_an_error_with_its_line(tmp_path, text, message):
    with pytest.raises(NagiosError, match=message):
        objects(tmp_path, text)


def test_a_file_that_is_not_there_is_an_error_with_the_way_out(tmp_path):
    (tmp_path / "nagios.cfg").write_text("cfg_file=/nowhere/hosts.cfg\n")

    with pytest.raises(
        NagiosError, match=r"nagios.cfg:1: cfg_file /nowhere/hosts.cfg does not exist"
    ):
        read([tmp_path / "nagios.cfg"])


ROBOT = "define host {\nhost_name a\n}\n"


def test_a_folder_may_have_the_main_files_of_another_machine(tmp_path):
    """Their settings count; their paths are of that machine."""
    (tmp_path / "robots.cfg").write_text(ROBOT)
    (tmp_path / "nagios.cfg").write_text(
        "log_file=/var/log/nagios.log\ncfg_file=/etc/passwd\ncfg_dir=/etc\ninterval_length=10\n"
    )
    (tmp_path / "cgi.cfg").write_text("main_config_file=/etc/nagios4/nagios.cfg\nuse_ssl=0\n")
    (tmp_path / "resource.cfg").write_text("$USER1$=/plugins\n")

    found = read([tmp_path])

    assert [each.value("host_name") for each in found.definitions] == ["a"]
    kinds = {each.key: each.kind for each in found.settings}
    assert (kinds["interval_length"], kinds["$USER1$"], kinds["use_ssl"]) == (
        *("main", "resource", "main"),
    )
    assert {each.key for each in found.skipped} == {"cfg_file", "cfg_dir"}


def test_what_a_main_file_of_another_machine_names_is_looked_for_beside_it(tmp_path):
    (tmp_path / "conf.d").mkdir()
    (tmp_path / "conf.d/robots.cfg").write_text(ROBOT)
    (tmp_path / "other.cfg").write_text(ROBOT.replace("name a", "name b"))
    main = tmp_path / "nagios.cfg"
    main.write_text("cfg_dir=/srv/nowhere/conf.d\ncfg_file=/srv/nowhere/objects/other.cfg\n")

    assert [each.value("host_name") for each in read([main]).definitions] == ["a", "b"]


def test_folders_that_run_in_circles_are_read_once(tmp_path):
    (tmp_path / "robots.cfg").write_text(ROBOT)
    (tmp_path / "again").symlink_to(tmp_path)

    assert len(read([tmp_path]).definitions) == 1
