"""The pictures of the mails are of the mails that are sent, and small."""

import pytest

from mail_pictures import PICTURES, stale
from support.shipped_rules import ROOT


def test_the_pictures_are_of_the_present_mails():
    assert not stale(), "./run generate makes them; it needs Chromium"


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_shown(name: str):
    assert f"(images/{name})" in (ROOT / "docs" / "notifications.md").read_text("utf-8")
