"""Hooks of mkdocs: pages beside docs/, the list of runbooks, links to files that are no pages."""

from __future__ import annotations

import re
from pathlib import Path
from posixpath import join, normpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

CHECKOUT = Path(__file__).resolve().parents[1]
BESIDE = {
    "README.md": "index.md",
    "SECURITY.md": "SECURITY.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
}
SHIM = "iframe-worker.js"  # in place of one from another server
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)#\s]+)(#[^)]*)?\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List every runbook."""
    runbooks = sorted((CHECKOUT / "docs" / "alerts").glob("*.md"))
    pages = [{each.stem.removeprefix("RosDiagnostics"): f"alerts/{each.name}"} for each in runbooks]
    for section in config.nav or []:
        for entries in section.values():
            for entry in entries if isinstance(entries, list) else ():
                if "Runbooks" in entry:
                    entry["Runbooks"] = pages
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are beside docs/, and what search needs in a folder."""
    script = (CHECKOUT / "tools" / SHIM).read_text(encoding="utf-8")
    files.append(File.generated(config, SHIM, content=script))
    for source, page in BESIDE.items():
        text = (CHECKOUT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=moved(text, ".", files)))
    return files


def on_page_markdown(markdown: str, *, page: Page, files: Files, **_: MkDocsConfig) -> str:
    """Let links to what is beside docs/ lead to its page, or to nothing."""
    if page.file.src_uri in BESIDE.values():
        return markdown
    return moved(markdown, join("docs", page.file.src_uri.rpartition("/")[0]), files)


def moved(markdown: str, folder: str, files: Files) -> str:
    """The text of a page in ``folder`` of the checkout, with its links those of the site."""
    depth = normpath(folder).count("/") if folder != "." else 0

    def link(found: re.Match[str]) -> str:
        image, text, target, anchor = found.groups(default="")
        path = normpath(join(folder, target))
        page = BESIDE.get(path, path.removeprefix("docs/"))
        if (path in BESIDE or path.startswith("docs/")) and _is_page(page, files):
            return f"{image}[{text}]({'../' * depth}{page}{anchor})"
        return text

    return LINK.sub(link, markdown)


def _is_page(page: str, files: Files) -> bool:
    return page in BESIDE.values() or files.get_file_from_path(page) is not None
