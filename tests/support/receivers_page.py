"""The receivers of docs/receivers.md, beside the shipped ones."""

import re
from pathlib import Path
from typing import Any

import yaml

from testbed.configuration import CHECKOUT

PAGE = (CHECKOUT / "docs" / "receivers.md").read_text(encoding="utf-8")


def documented() -> list[dict[str, Any]]:
    """Each receiver that the page shows."""
    return [
        receiver
        for text in re.findall(r"^```yaml\n(- name: .*?)^```", PAGE, re.MULTILINE | re.DOTALL)
        for receiver in yaml.safe_load(text)
    ]


def configuration(receivers: list[dict[str, Any]]) -> dict[str, Any]:
    """A configuration with the shipped templates that sends every alert to each receiver."""
    routes = [{"receiver": each["name"], "continue": True} for each in receivers]
    route = {"receiver": "none", "group_by": ["..."], "group_wait": "0s", "group_interval": "1s"}
    templates = [str(CHECKOUT / "alertmanager" / "templates" / "*.tmpl")]
    return {
        "templates": templates,
        "route": route | {"routes": routes},
        "receivers": [{"name": "none"}, *receivers],
    }


def written(folder: Path, receivers: list[dict[str, Any]]) -> Path:
    """The file of such a configuration."""
    file = folder / "alertmanager.yml"
    file.write_text(yaml.safe_dump(configuration(receivers)), encoding="utf-8")
    return file
