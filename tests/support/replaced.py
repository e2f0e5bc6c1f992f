"""A file that another program reads while it is written."""

from pathlib import Path


def replace_text(path: Path, text: str) -> None:
    """Give the file this text at once: nobody reads half of it."""
    new = path.with_suffix(".new")
    new.write_text(text)
    new.replace(path)
