"""An exporter whose network changes receives its robots again, and blames none of them."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from support import subnets
from support.one_subnet import OneSubnet
from testbed.polling import until

pytestmark = pytest.mark.slow


@pytest.fixture
def site(tmp_path: Path) -> Iterator[OneSubnet]:
    if why := subnets.missing():
        pytest.skip(why)
    with ExitStack() as stack:
        yield OneSubnet(stack, tmp_path)


def address(site: OneSubnet, *arguments: str) -> None:
    site.run("ip", "address", *arguments, "dev", "eth0")


def test_another_address_is_followed_without_a_fault_of_a_robot(site):
    site.start_exporter()
    until(lambda: site.received() == 3, "all are received", 60, every=0.5)
    address(site, "delete", "10.77.2.2/16")
    address(site, "add", "10.77.9.9/16")
    changed = site.ask("fleet")["time"]
    until(lambda: site.received(after=changed + 2) == 3, "all are received again", 30, every=0.5)
    assert site.faults() == []


def test_an_exporter_that_starts_before_its_address_receives_once_it_has_it(site):
    address(site, "delete", "10.77.2.2/16")
    site.start_exporter()
    until(site.is_joined, "it is joined", 30, every=0.5)
    address(site, "add", "10.77.2.2/16")
    until(lambda: site.received() == 3, "all are received", 30, every=0.5)
