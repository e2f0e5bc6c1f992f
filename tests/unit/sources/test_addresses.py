"""The addresses of this machine as the kernel lists them."""

from pathlib import Path

import pytest

from ros_diagnostics_exporter.sources.addresses import local_addresses, update_fast_dds

TABLE = """Main:
  +-- 0.0.0.0/1 2 0 2
     +-- 10.1.1.0/24 2 0 2
        +-- 10.1.1.0/31 1 0 0
           |-- 10.1.1.0
              /24 host LOCAL
           |-- 10.1.1.1
              /32 host LOCAL
        |-- 10.1.1.255
           /32 link BROADCAST
     +-- 127.0.0.0/8 2 0 2
           |-- 127.0.0.1
              /32 host LOCAL
Local:
           |-- 10.1.1.1
              /32 host LOCAL
           |-- 192.168.7.9
              /32 host LOCAL
"""


def test_addresses_of_interfaces_are_read_without_the_loopback_and_broadcasts(tmp_path: Path):
    (tmp_path / "fib_trie").write_text(TABLE)
    assert local_addresses(tmp_path / "fib_trie") == {"10.1.1.1", "192.168.7.9"}


def test_where_the_kernel_does_not_say_there_are_none(tmp_path: Path):
    assert local_addresses(tmp_path / "none") == frozenset()


def test_fast_dds_reads_the_interfaces_again_where_it_is_loaded(tmp_path: Path):
    pytest.importorskip("rclpy").get_rmw_implementation_identifier()
    assert update_fast_dds() == 1
    (tmp_path / "maps").write_text("7f00-7f01 r-xp 0000 00:01 1 /usr/lib/libc.so.6\n")
    assert update_fast_dds(tmp_path / "maps") == 0
    assert update_fast_dds(tmp_path / "none") == 0
