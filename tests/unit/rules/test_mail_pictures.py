"""The pictures of the mails are of the mails that are sent, and small."""

from __future__ import annotations

import pytest

from mail_pictures import IMAGES, PICTURES, SIGNATURE, source_of, stale
from support.shipped_rules import ROOT

ALL_IMAGES = 1_000_000  # bytes of docs/images


def test_the_pictures_are_of_the_present_mails():
    assert not stale(), "./run generate makes them; it needs Chromium"


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_shown(name: str):
    assert f"(images/{name})" in (ROOT / "docs" / "notifications.md").read_text("utf-8")


def test_a_picture_without_a_source_names_none():
    end = b"\0\0\0\0IEND\xaeB`\x82"

    assert source_of(SIGNATURE + end) == b""


def test_the_documentations_images_are_small():
    assert sum(each.stat().st_size for each in IMAGES.iterdir()) < ALL_IMAGES
