"""A fleet from a text."""

from pathlib import Path

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load


def load_text(folder: Path, text: str) -> Fleet:
    """Load a text as the folder's fleet.yml."""
    path = folder / "fleet.yml"
    path.write_text(text, encoding="utf-8")
    return load(path)
