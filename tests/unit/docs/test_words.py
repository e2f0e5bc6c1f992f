"""What people read of the product has the words of docs/glossary.md, and none that it retires."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[3]
GLOSSARY = (CHECKOUT / "docs" / "glossary.md").read_text("utf-8")
# Python's words in messages of the system, such as "Connection refused", are not ours.
TEXTS = [
    *(CHECKOUT / "exporter").rglob("*.html*"),
    *(CHECKOUT / "alertmanager").rglob("*.tmpl"),
    *(CHECKOUT / "prometheus" / "rules").glob("*.yml"),
]
MODULES = sorted((CHECKOUT / "exporter").glob("ros_diagnostics_*/**/*.py"))


def retired() -> re.Pattern[str]:
    table = GLOSSARY.partition("| not | but |\n|---|---|\n")[2]
    words = [word for row in table.splitlines() for word in row.split("|")[1].strip().split(", ")]
    assert len(words) > 5
    return re.compile(rf"\b({'|'.join(words)})s?\b", re.IGNORECASE)


def strings(module: Path) -> Iterator[str]:
    """Every string of a module, but for its docstrings."""
    tree = ast.parse(module.read_text("utf-8"))
    alone = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.Constant) and isinstance(each.value, str) and id(each) not in alone:
            yield each.value


@pytest.mark.parametrize(
    "file", [*MODULES, *TEXTS], ids=lambda path: str(path.relative_to(CHECKOUT))
)
def test_no_string_has_a_retired_word(file: Path):
    texts = strings(file) if file.suffix == ".py" else [file.read_text("utf-8")]

    assert not [text for text in texts if retired().search(text)]
