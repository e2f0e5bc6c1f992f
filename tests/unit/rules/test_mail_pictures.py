"""The pictures of the mails are of the mails that are sent, and small."""

from __future__ import annotations

import pytest

from mail_pictures import IMAGES, MAILS, PICTURES, SIGNATURE, source, source_of
from support.shipped_rules import ROOT

ALL_IMAGES = 1_000_000  # bytes of docs/images


@pytest.mark.parametrize(("name", "mail"), [(name, mail) for name, (mail, _) in PICTURES.items()])
def test_a_picture_is_of_the_present_mail_and_shown(name: str, mail: str):
    """If not, run: python tools/mail_pictures.py."""
    picture = (IMAGES / name).read_bytes()

    assert source_of(picture) == source((MAILS / mail).read_text("utf-8"))
    assert f"(images/{name})" in (ROOT / "docs" / "notifications.md").read_text("utf-8")


def test_a_picture_without_a_source_names_none():
    end = b"\0\0\0\0IEND\xaeB`\x82"

    assert source_of(SIGNATURE + end) == b""


def test_the_documentations_images_are_small():
    assert sum(each.stat().st_size for each in IMAGES.iterdir()) < ALL_IMAGES
