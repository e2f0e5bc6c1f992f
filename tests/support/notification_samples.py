"""The samples of docs/reference/mails.md, between `<!-- samples -->` and `<!-- end -->`."""

import re
from collections.abc import Mapping

_BLOCK = re.compile(r"(<!-- samples -->\n).*?(<!-- end -->)", re.DOTALL)


def updated(document: str, samples: Mapping[str, str]) -> str:
    """The document with these samples, by what each of them is.

    Raises:
        ValueError: The document has no place for them.
    """
    text = "\n".join(f"{what}:\n\n```text\n{sample}\n```\n" for what, sample in samples.items())
    new, found = _BLOCK.subn(lambda match: f"{match[1]}{text}{match[2]}", document)
    if found != 1:
        raise ValueError("the document has no <!-- samples --> and <!-- end -->")
    return new
