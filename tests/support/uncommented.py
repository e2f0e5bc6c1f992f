"""The shipped alertmanager.yml with what it has in comments."""

from typing import Any

import yaml

from testbed.configuration import CHECKOUT


def uncommented(*pieces: str) -> dict[str, Any]:
    """Its content with some commented lines in use."""
    text = (CHECKOUT / "alertmanager" / "alertmanager.yml").read_text()
    for piece in pieces:
        assert text.count(piece) == 1, piece
        text = text.replace(piece, piece.replace("# ", ""))
    content: dict[str, Any] = yaml.safe_load(text)
    return content
