"""What makes the shipped alertmanager.yml one with people on call, as docs/on-call.md says."""

from pathlib import Path

MARKER = "    - {matchers: [severity = critical], receiver: on-call, continue: true}\n"
_COMMENTED = MARKER.replace("- ", "# - ", 1)


def with_marker(config: Path) -> None:
    """Uncomment the route to the person on call."""
    text = config.read_text(encoding="utf-8")
    assert text.count(_COMMENTED) == 1
    config.write_text(text.replace(_COMMENTED, MARKER), encoding="utf-8")
