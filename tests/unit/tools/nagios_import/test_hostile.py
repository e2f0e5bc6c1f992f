"""Files that were made to take all time or memory are an error that names them."""

import time

import pytest

from ros_diagnostics_tools.nagios.importer import files
from ros_diagnostics_tools.nagios.importer.convert import ImportOptions, convert
from ros_diagnostics_tools.nagios.importer.files import NagiosError
from ros_diagnostics_tools.nagios.importer.hours import hours
from ros_diagnostics_tools.nagios.importer.inheritance import Templates
from ros_diagnostics_tools.nagios.importer.ledger import ImportLedger
from ros_diagnostics_tools.nagios.importer.site import Site

SECONDS = 20  # doubled by each of 41 templates it would take days


def define(kind, *lines):
    return f"define {kind} {{\n" + "".join(f"  {each}\n" for each in lines) + "}\n"


def imported(tmp_path, text, name="site.cfg"):
    path = tmp_path / name
    path.write_text(text)
    begin = time.monotonic()
    try:
        return convert([path], ImportOptions("f"))
    finally:
        assert time.monotonic() - begin < SECONDS


@pytest.mark.parametrize(
    "last", ["check_command x", "contacts +a"], ids=["a value", "a list that is added to"]
)
def test_templates_that_are_used_twice_by_one_another(tmp_path, last):
    parts = [define("host", "name t0", "register 0", "contacts +a")]
    parts += [
        define("host", f"name t{n}", f"use t{n - 1},t{n - 1}", "register 0", last)
        for n in range(1, 41)
    ]
    imported(tmp_path, "".join((*parts, define("host", "host_name h", "use t40,t40"))))


def test_a_value_that_templates_make_longer_and_longer(tmp_path):
    parts = [define("host", *(f"name {each}0" for each in "a"), "register 0", "contacts +a")]
    for n in range(1, 41):
        parts += [
            define("host", f"name {one}{n}", f"use a{n - 1},b{n - 1}", "register 0", "contacts +a")
            for one in "ab"
        ]
    parts.insert(0, define("host", "name b0", "register 0", "contacts +a"))
    with pytest.raises(NagiosError, match="contacts is longer than 1,000,000 characters"):
        imported(tmp_path, "".join((*parts, define("host", "host_name h", "use a40"))))


def test_a_chain_of_templates_groups_or_timeperiods(tmp_path):
    chain = [
        define("host", f"name t{n}", f"use t{n - 1}" if n else "", "register 0")
        for n in range(5000)
    ]
    with pytest.raises(NagiosError, match="more than 100 templates are above one another"):
        imported(tmp_path, "".join((*chain, define("host", "host_name h", "use t4999"))))
    groups = [
        define("hostgroup", f"hostgroup_name g{n}", f"hostgroup_members g{n + 1},g{n + 1}")
        for n in range(5000)
    ]
    service = define("service", "hostgroup_name g0", "service_description s")
    with pytest.raises(NagiosError, match="more than 200 groups are within one another"):
        imported(tmp_path, "".join((*groups, service)))


def periods(tmp_path, count):
    path = tmp_path / "periods.cfg"
    path.write_text(
        "".join(
            define("timeperiod", f"timeperiod_name p{n}", f"exclude p{n + 1},p{n + 1}")
            for n in range(count)
        )
    )
    things = Templates(files.read([path]).definitions, ImportLedger()).things()
    return hours(Site(ImportLedger(), {}, {"timeperiod": things}), "p0")


def test_timeperiods_that_exclude_one_another(tmp_path):
    begin = time.monotonic()
    assert periods(tmp_path, 41).never
    assert time.monotonic() - begin < SECONDS
    with pytest.raises(NagiosError, match="more than 100 exclude one another"):
        periods(tmp_path, 5000)


@pytest.mark.parametrize("key", ["resource_file", "cfg_file"])
def test_a_device_is_no_file_of_nagios(tmp_path, key):
    with pytest.raises(NagiosError, match=r"/dev/zero: it is not a regular file|Invalid argument"):
        imported(tmp_path, f"log_file=x\n{key}=/dev/zero\n", "nagios.cfg")


def test_a_file_that_is_too_large_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "MOST_BYTES", 100)
    with pytest.raises(NagiosError, match=r"site\.cfg: has more than 0 MB"):
        imported(tmp_path, define("host", "host_name " + "h" * 100))


def test_a_line_of_hours_that_matches_in_many_ways(tmp_path):
    line = "monday " + "1:1-1:1   " * 60 + "x"
    imported(tmp_path, define("timeperiod", "timeperiod_name p", line))


@pytest.mark.parametrize("pattern", ["(a+)+$", "("])
def test_a_regular_expression_takes_linear_time(tmp_path, pattern):
    (tmp_path / "objects.cfg").write_text(
        define("host", f"host_name {'a' * 60}!")
        + define("service", f"host_name {pattern}", "service_description s")
    )
    imported(tmp_path, "cfg_file=objects.cfg\nuse_true_regexp_matching=1\n", "nagios.cfg")


@pytest.mark.parametrize("key", ["interval_length", "high_service_flap_threshold"])
@pytest.mark.parametrize("value", ["10 # seconds", "ten", ""])
def test_numbers_of_the_main_file_are_read_as_nagios_does(tmp_path, key, value):
    (tmp_path / "objects.cfg").write_text(define("host", "host_name h"))
    imported(tmp_path, f"cfg_file=objects.cfg\n{key}={value}\n", "nagios.cfg")
