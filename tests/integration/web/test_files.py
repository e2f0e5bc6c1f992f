"""No file harms the exporter: special, hanging and damaged files."""

import os
import sqlite3
import sys
import urllib.error
from contextlib import closing

import pytest

from support.exposition import value
from testbed.polling import until
from testbed.processes import Process


def metric(site, name: str) -> float | None:
    return value(site.address, f"exporter_{name}")


def test_a_fifo_among_the_files_is_named_and_silent_robots_are_detected(site):
    exporter = site.serve()
    robots = site.start_robots(2).process
    until(lambda: site.up() == 2, exporter.describe)

    folder = site.folder / "robots.d"
    folder.mkdir()
    os.mkfifo(folder / "fifo.yml")
    until(lambda: metric(site, "config_last_reload_successful") == 0, exporter.describe)
    until(lambda: f"{folder}/fifo.yml: cannot be read" in exporter.output(), exporter.describe)
    robots.stop()
    until(lambda: site.up() == 0, exporter.describe)

    (folder / "fifo.yml").unlink()
    until(lambda: metric(site, "config_last_reload_successful") == 1, exporter.describe)
    os.mkfifo(folder / "fifo.yml")
    assert exporter.stop() == 0


# The exporter on a machine whose disk never responds for files named hung.yml.
HUNG = """
import sys, threading
from ros_diagnostics_exporter.cli import main as cli
from ros_diagnostics_exporter.config import reloader, yaml_file

reloader.TIMEOUT = 2.0
read = yaml_file.read_regular
def read_or_hang(path, most):
    if path.name == "hung.yml":
        threading.Event().wait()
    return read(path, most)
yaml_file.read_regular = read_or_hang
sys.exit(cli.main())
"""


def test_a_hanging_file_blocks_neither_ingest_nor_scrapes_nor_sigterm(site):
    program = site.process("--web.enable-lifecycle")
    command = [sys.executable, "-c", HUNG, *program.argv[1:]]
    exporter = Process("exporter", command, site.environment(), site.folder / "hung.log")
    site.serve(process=exporter)
    robots = site.start_robots(2).process
    until(lambda: site.up() == 2, exporter.describe)

    folder = site.folder / "robots.d"
    folder.mkdir()
    (folder / "hung.yml").write_text("{name: r, domain_id: 1}")
    with pytest.raises(urllib.error.HTTPError) as caught:
        site.ask("/-/reload", "POST")
    assert caught.value.code == 400
    assert "has not been read after 2 s" in caught.value.read().decode()
    robots.stop()
    until(lambda: site.up() == 0, exporter.describe)
    until(lambda: metric(site, "config_last_reload_successful") == 0, exporter.describe)
    until(lambda: "no reload is possible until its disk" in exporter.output(), exporter.describe)

    assert exporter.stop(30) == 0


@pytest.fixture
def database(site):
    """The database of an exporter with two robots, one of them with a fault."""
    path = site.folder / "exporter.db"
    exporter = site.serve()
    robots = site.start_robots(2).process
    until(lambda: site.up() == 2, exporter.describe)
    site.fault("robot_1", "Motor 2", "error")
    until(lambda: "ERROR" in levels(site, "robot_1"), exporter.describe)
    assert exporter.stop() == 0
    robots.stop()
    return path


def levels(site, name: str) -> set[str]:
    """The levels of a robot's components."""
    robots = {robot["robot"]: robot for robot in site.ask("/api/v1/fleet")["robots"]}
    return {each["level"] for each in robots[name]["components"]}


def test_damaged_databases_are_renamed_and_the_exporter_starts(site, database):
    whole = database.read_bytes()
    zeros = whole[:4096] + bytes(len(whole) - 4096)
    free = int.from_bytes(whole[36:40], "big") + 5
    counted = whole[:36] + free.to_bytes(4, "big") + whole[40:]
    damages = (zeros, b'{"version": 1, "robots": []}', counted)
    for number, damaged in enumerate(damages, 1):
        database.write_bytes(damaged)
        exporter = site.serve()
        aside = database.with_name(f"exporter.db.damaged-{number}")
        exporter.wait_for_output(f"it is kept as {aside}")
        until(lambda: metric(site, "storage_last_write_successful") == 1, exporter.describe)
        known = [robot["robot"] for robot in site.ask("/api/v1/fleet")["robots"]]
        assert known == (["robot_1", "robot_2"] if damaged is damages[-1] else [])
        assert aside.read_bytes() == damaged
        assert exporter.stop() == 0
    with closing(sqlite3.connect(database)) as connection:
        assert [*connection.execute("SELECT name FROM robots")] == [("robot_1",), ("robot_2",)]


# The exporter on a machine whose disk no longer answers once it has written.
HANGING = """
import sys, threading
from ros_diagnostics_exporter.cli import main as cli
from ros_diagnostics_exporter.storage import database

write = database.Database.write
def write_or_hang(self, *arguments, **more):
    write(self, *arguments, **more)
    threading.Event().wait()
database.Database.write = write_or_hang
sys.exit(cli.main())
"""


def test_a_hanging_disk_of_the_database_stops_nothing(site):
    program = site.process()
    command = [sys.executable, "-c", HANGING, *program.argv[1:]]
    exporter = Process("exporter", command, site.environment(), site.folder / "hanging.log")
    site.serve(process=exporter)
    robots = site.start_robots(2).process
    until(lambda: site.up() == 2, exporter.describe)
    until(lambda: metric(site, "storage_last_write_successful") == 0, exporter.describe)
    robots.stop()
    until(lambda: site.up() == 0, exporter.describe)
    found = site.ask("/api/v1/events?kind=robot&limit=2")["events"]
    assert {each["after"] for each in found} == {"silent"}

    assert exporter.stop(30) == 0
    assert "could not save the state before the exit" in exporter.output()
