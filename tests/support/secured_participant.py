"""A participant with DDS security, by the Cyclone DDS of Debian: run as a program.

usage: secured_participant.py offer|try DOMAIN ENCLAVE TOPIC...

offer: publishes on the topic until it is stopped. try: prints as JSON which topics it may write,
which it may read, and how many publishers its subscription of the first one matches. One process
has one participant: of two, Cyclone DDS 0.10 judges the second by the rights of the first.
"""

import ctypes
import json
import signal
import sys
import time
from pathlib import Path

LIBRARY = "libddsc.so.0debian"
PLUGINS = Path("/usr/lib/x86_64-linux-gnu/libddsc0debian")
SECONDS = 30.0
FORBIDDEN = -13  # DDS_RETCODE_NOT_ALLOWED_BY_SECURITY
# The description of a type with one number: address of four bytes at offset 0, end.
OPERATIONS = (ctypes.c_uint32 * 3)(0x01 << 24 | 0x03 << 16, 0, 0)


class Meta(ctypes.Structure):
    _fields_ = (("data", ctypes.c_void_p), ("size", ctypes.c_uint32))


class Descriptor(ctypes.Structure):
    """dds_topic_descriptor_t of Cyclone DDS 0.10."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("align", ctypes.c_uint32),
        ("flags", ctypes.c_uint32),
        ("key_count", ctypes.c_uint32),
        ("type_name", ctypes.c_char_p),
        ("keys", ctypes.c_void_p),
        ("operation_count", ctypes.c_uint32),
        ("operations", ctypes.POINTER(ctypes.c_uint32)),
        ("meta", ctypes.c_char_p),
        ("information", Meta),
        ("mapping", Meta),
        ("representation", ctypes.c_uint32),
    )


KIND = Descriptor(4, 4, 0, 0, b"test::Number", None, 2, OPERATIONS, b"")


class Participant:
    def __init__(self, library: ctypes.CDLL, domain_id: int, enclave: Path) -> None:
        self._dds = library
        library.dds_create_qos.restype = ctypes.c_void_p
        qos = ctypes.c_void_p(library.dds_create_qos())
        for name, value in _properties(enclave).items():
            library.dds_qset_prop(qos, name.encode(), value.encode())
        self._id = library.dds_create_participant(domain_id, qos, None)
        if self._id < 0:
            raise SystemExit(f"{enclave}: not let in: {self._id}")

    def _endpoint(self, create, topic: str) -> int:
        made = self._dds.dds_create_topic(self._id, ctypes.byref(KIND), topic.encode(), None, None)
        return made if made < 0 else create(self._id, made, None, None)

    def writer(self, topic: str) -> int:
        return self._endpoint(self._dds.dds_create_writer, topic)

    def reader(self, topic: str) -> int:
        return self._endpoint(self._dds.dds_create_reader, topic)

    def count_matched(self, reader: int) -> int:
        return self._dds.dds_get_matched_publications(reader, None, 0)

    def may(self, endpoint: int) -> bool:
        if endpoint < 0 and endpoint != FORBIDDEN:
            raise SystemExit(f"neither made nor forbidden: {endpoint}")
        return endpoint > 0


def _properties(enclave: Path) -> dict[str, str]:
    found = {
        "dds.sec.auth.identity_ca": f"file:{enclave}/identity_ca.cert.pem",
        "dds.sec.auth.identity_certificate": f"file:{enclave}/cert.pem",
        "dds.sec.auth.private_key": f"file:{enclave}/key.pem",
        "dds.sec.access.permissions_ca": f"file:{enclave}/permissions_ca.cert.pem",
        "dds.sec.access.governance": f"file:{enclave}/governance.p7s",
        "dds.sec.access.permissions": f"file:{enclave}/permissions.p7s",
    }
    for part, name, function in (
        ("auth", "auth", "authentication"),
        ("crypto", "crypto", "crypto"),
        ("access", "ac", "access_control"),
    ):
        prefix = f"dds.sec.{part}.library"
        found[f"{prefix}.path"] = str(PLUGINS / f"libdds_security_{name}.so")
        found[f"{prefix}.init"] = f"init_{function}"
        found[f"{prefix}.finalize"] = f"finalize_{function}"
    return found


def offer(participant: Participant, topic: str) -> None:
    """Have a publisher until the process is stopped."""
    if not participant.may(participant.writer(topic)):
        raise SystemExit(f"may not write {topic}")
    print("offered", flush=True)
    signal.pause()


def try_all(participant: Participant, topics: list[str]) -> None:
    """Print what the participant may do."""
    readers = {topic: participant.reader(topic) for topic in topics}
    end = time.monotonic() + SECONDS
    matched = 0
    while not matched and time.monotonic() < end:
        time.sleep(0.1)
        matched = participant.count_matched(readers[topics[0]])
    reads = [each for each in topics if participant.may(readers[each])]
    writes = [each for each in topics if participant.may(participant.writer(each))]
    print(json.dumps({"matched": matched, "reads": reads, "writes": writes}), flush=True)


def main() -> None:
    what, domain_id, enclave, *topics = sys.argv[1:]
    participant = Participant(ctypes.CDLL(LIBRARY), int(domain_id), Path(enclave))
    if what == "offer":
        offer(participant, topics[0])
    else:
        try_all(participant, topics)


if __name__ == "__main__":
    main()
