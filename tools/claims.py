"""Lists sentences of the pages that promise most which name no test: ``./run docs --claims``."""

from __future__ import annotations

import re
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
PAGES = ("docs/alerts.md", "docs/notifications.md", "docs/metrics.md", "SECURITY.md")
PROMISE = re.compile(r"\b(never|always|none|nothing|nobody|exactly|ends? no\w*)\b", re.IGNORECASE)
NO_PROSE = re.compile(
    r"^ *```.*?^ *```|^[|#].*?$|^<!-- \w+ -->.*?<!-- end -->", re.DOTALL | re.MULTILINE
)
# A sentence, and the comments that follow it.
SENTENCE = re.compile(r"(?:[^.]|\.(?=\S))+\.?(?:\s*<!--.*?-->)*")


def unmarked(text: str) -> list[str]:
    """The sentences with a word of promise and without a test."""
    blocks = re.split(r"\n\s*\n|\n- ", NO_PROSE.sub("", text))
    sentences = [each for block in blocks for each in SENTENCE.findall(" ".join(block.split()))]
    return [each.strip() for each in sentences if PROMISE.search(each) and "<!-- shown" not in each]


def main() -> None:
    """Print them."""
    for page in PAGES:
        for sentence in unmarked((CHECKOUT / page).read_text(encoding="utf-8")):
            print(f"{page}: {sentence}")  # noqa: T201


if __name__ == "__main__":
    main()
