"""The pictures of the mails are of the mails that are sent, and small."""

import struct
import sys
import zlib

import pytest

from mail_pictures import KEYWORD, PICTURES, SIGNATURE, _run, _with_source, source_of, stale
from support.shipped_rules import ROOT


def test_the_pictures_are_of_the_present_mails():
    assert not stale(), "./run generate makes them; it needs Chromium"


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_shown(name: str):
    assert f"(images/{name})" in (ROOT / "docs" / "notifications.md").read_text("utf-8")


def test_a_picture_names_its_mail_in_a_chunk_of_its_own_behind_its_header():
    header, rest = SIGNATURE + struct.pack(">I4s17x", 13, b"IHDR"), b"r" * 30
    picture = _with_source(header + rest, b"of a mail")
    assert source_of(picture) == b"of a mail"
    chunk = picture.removeprefix(header).removesuffix(rest)
    length, text, checksum = chunk[:4], chunk[4:-4], chunk[-4:]
    assert text == b"tEXt" + KEYWORD + b"\0of a mail"
    assert int.from_bytes(length, "big") == len(text) - 4
    assert int.from_bytes(checksum, "big") == zlib.crc32(text)
    with pytest.raises(RuntimeError, match="wrote no PNG"):
        _with_source(b"GIF", b"")


def test_a_browser_that_fails_makes_no_picture():
    assert _run([sys.executable, "-c", "print(1)"]) == "1\n"
    with pytest.raises(RuntimeError, match="failed: no display"):
        _run([sys.executable, "-c", "import sys; sys.exit('no display')"])
