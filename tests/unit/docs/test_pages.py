"""Links of the documentation lead somewhere, and each claim names a test that exists."""

import re
from pathlib import Path

import pytest

import claims
from support.named_tests import find_missing

CHECKOUT = Path(__file__).parents[3]
PAGES = sorted([*CHECKOUT.glob("*.md"), *(CHECKOUT / "docs").rglob("*.md")])
# A claim and the test that shows it: one comment each, as the name of a test may have commas.
SHOWN_BY = re.compile(r"<!-- shown by: (tests/\S+\.py.*?) -->")


def shown_by(page: Path) -> set[str]:
    return set(SHOWN_BY.findall(page.read_text("utf-8")))


def anchors(page: Path) -> set[str]:
    """As GitHub makes them of headings."""
    headings = re.findall(r"^#+ (.+)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path):
    for name, anchor in re.findall(
        r"\]\((?!https?:)([^)#]*)(?:#([^)]+))?\)", page.read_text("utf-8")
    ):
        target = page.parent / name if name else page
        assert target.exists(), name
        assert not anchor or anchor in anchors(target), f"{name}#{anchor}"


def test_every_test_that_a_claim_names_exists(request: pytest.FixtureRequest):
    named = {test for page in PAGES for test in shown_by(page)}
    assert find_missing(named, request.session) == set()


@pytest.mark.parametrize("page", claims.PAGES)
def test_the_pages_that_promise_most_name_a_test_for_each_promise(page: str):
    assert claims.unmarked((CHECKOUT / page).read_text("utf-8")) == []


def test_a_promise_without_a_test_is_found():
    shown = "It never ends. <!-- shown by: tests/a.py::b -->"
    text = f"{shown} Nothing is lost.\n\n| never | in a table |\n\nIt may."

    assert claims.unmarked(text) == ["Nothing is lost."]
