"""Puts the results of docs/experiments/ into the pages that show them.

A page has `<!-- result: NAME -->` and `<!-- end -->`; what is between them becomes NAME.md and the
plot. `./run generate` writes the pages, after results were copied to docs/experiments/.
"""

from __future__ import annotations

import re
from pathlib import Path

from experiments.machine import CHECKOUT

DOCS = CHECKOUT / "docs"
PAGES = ("experiments.md", "performance.md")
SECTION = re.compile(r"(<!-- result: (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)


def files() -> dict[Path, str]:
    """Return the pages with their results."""
    paths = [DOCS / name for name in PAGES]
    return {path: filled(path.read_text(), DOCS / "experiments") for path in paths}


def filled(page: str, folder: Path) -> str:
    """Return a page with its results put in.

    Raises:
        FileNotFoundError: A result that it names is not in ``folder``.
    """

    def section(found: re.Match[str]) -> str:
        begin, name, end = found.groups()
        text = (folder / f"{name}.md").read_text()
        plot = folder / f"{name}.png"
        image = f"![{name}]({folder.name}/{plot.name})\n\n" if plot.exists() else ""
        return f"{begin}\n{image}{text}\n{end}"

    return SECTION.sub(section, page)
