"""docs/dashboards.md names dashboards and panels that exist."""

import re

from support.committed_dashboards import BOARDS, ROOT, panels

PAGE = (ROOT / "docs" / "dashboards.md").read_text(encoding="utf-8")
PANELS = {(board["title"], panel["title"]) for board in BOARDS.values() for panel in panels(board)}


def test_the_table_of_nagios_pages_and_rqt_views_names_panels_that_exist():
    rows = re.findall(r"^\| (?:Nagios|rqt_\w+): .+? \| (.+) \|$", PAGE, re.MULTILINE)
    titles = {board["title"] for board in BOARDS.values()}
    named = {
        (board, re.sub(r" \(.*", "", panel).strip())
        for row in rows
        for board, panel in re.findall(rf"({'|'.join(titles)}) / ([^,|]+)", row)
    }

    assert len(rows) > 20
    assert named - PANELS == set()


def test_the_page_has_the_path_of_every_dashboard():
    assert set(re.findall(r"`/d/([\w-]+)`", PAGE)) == set(BOARDS)
