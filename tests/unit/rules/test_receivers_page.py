"""The receivers of docs/receivers.md are accepted by amtool."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from support.receivers_page import PAGE, documented, written
from support.shipped_rules import run_tool

RECEIVERS = documented()


@pytest.mark.parametrize("receiver", RECEIVERS, ids=lambda each: each["name"])
def test_amtool_accepts_each_receiver(receiver: dict[str, Any], tmp_path: Path):
    assert "SUCCESS" in run_tool("amtool", "check-config", written(tmp_path, [receiver]))


def test_the_route_is_to_a_receiver_of_the_page():
    _, _, text = PAGE.partition("that are there\n")
    [route] = yaml.safe_load(text.partition("```")[0])

    assert route["receiver"] in {each["name"] for each in RECEIVERS}
