"""The IPv4 addresses of this machine, except its loopback's, for itself and for Fast DDS.

A participant of DDS uses the interfaces that have an address when it joins, and those alone.
"""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

TABLE = Path("/proc/net/fib_trie")
LIBRARIES = Path("/proc/self/maps")
_FAST_DDS = re.compile(r"/\S*/libfast(?:rtps|dds)\.so\S*$", re.MULTILINE)
_UPDATE = "_ZN8eprosima10SystemInfo17update_interfacesEv"  # SystemInfo::update_interfaces()
_LOCAL = re.compile(r"\|-- (?!127\.)(\S+)\n\s+/32 host LOCAL")


def local_addresses(table: Path = TABLE) -> frozenset[str]:
    """Those of the interfaces that are up; none where the kernel does not say, as on no Linux."""
    try:
        return frozenset(_LOCAL.findall(table.read_text("ascii")))
    except FileNotFoundError:
        return frozenset()


def update_fast_dds(libraries: Path = LIBRARIES) -> int:
    """Have Fast DDS read the interfaces again, which it does once in a process; in how many copies.

    Else a domain that is joined anew is joined by the old addresses. Another middleware reads them
    each time.
    """
    try:
        paths = set(_FAST_DDS.findall(libraries.read_text(errors="replace")))
    except FileNotFoundError:
        return 0
    found = [update for path in paths if (update := getattr(ctypes.CDLL(path), _UPDATE, None))]
    for update in found:
        update()
    return len(found)
