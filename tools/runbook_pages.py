"""The runbooks of docs/alerts as HTML, which the exporter serves as pages."""

from __future__ import annotations

import json
import re
from pathlib import Path

from markdown_it import MarkdownIt

CHECKOUT = Path(__file__).resolve().parents[1]
RUNBOOKS = CHECKOUT / "docs" / "alerts"
PAGES = CHECKOUT / "exporter" / "ros_diagnostics_exporter" / "web" / "runbooks.json"
# A page of docs/, which the exporter does not serve, is named in place of its link.
_OF_DOCS = re.compile(r"\[([^\]]*)\]\(\.\./([\w/-]+\.md)[^)]*\)")
_OF_RUNBOOK = re.compile(r"\]\((\w+)\.md\)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def files() -> dict[Path, str]:
    """The pages by the names of their alerts."""
    pages = {page.stem: html(page.read_text(encoding="utf-8")) for page in RUNBOOKS.glob("*.md")}
    return {PAGES: json.dumps(pages, indent=0, sort_keys=True, ensure_ascii=False) + "\n"}


def html(text: str) -> str:
    """A runbook below its first heading."""
    body = _COMMENT.sub("", text.partition("\n")[2])
    linked = _OF_RUNBOOK.sub(r"](\1)", _OF_DOCS.sub(r"\1 (docs/\2)", body))
    rendered: str = MarkdownIt("commonmark", {"html": False}).enable("table").render(linked)
    return rendered
