"""The committed dashboards: what the source builds, valid, with links that work."""

import json
import re

import pytest

from support.committed_dashboards import BOARDS, panels

SDK = pytest.importorskip("grafana_foundation_sdk", reason="Grafana's SDK needs Python 3.11")

PLAIN = {"stat", "table", "timeseries", "state-timeline", "bargauge", "text"}
ALL_PANELS = [
    pytest.param(panel, id=f"{uid}: {panel['title']}")
    for uid, board in BOARDS.items()
    for panel in panels(board)
]


@pytest.mark.parametrize("uid", BOARDS)
def test_the_sdk_model_reads_the_json_and_writes_it_unchanged(uid: str):
    """A key that is not in Grafana's schema would be missing.

    Except for what an import by hand reads, and for the formats of annotations: they belong to
    Prometheus' data source.
    """
    from grafana_foundation_sdk.cog import plugins
    from grafana_foundation_sdk.cog.encoder import JSONEncoder
    from grafana_foundation_sdk.models.dashboard import Dashboard

    plugins.register_default_plugins()
    board = json.loads(json.dumps(BOARDS[uid]))
    assert board.pop("__requires")
    for annotation in board["annotations"].get("list", ()):
        assert annotation.pop("titleFormat")
        assert annotation.pop("textFormat")

    again = json.loads(json.dumps(Dashboard.from_json(board), cls=JSONEncoder))

    assert again == board


@pytest.mark.parametrize("uid", BOARDS)
def test_an_import_by_hand_is_told_what_the_dashboard_needs(uid: str):
    board = BOARDS[uid]
    needed = {(each["type"], each["id"]) for each in board["__requires"]}

    assert {each["type"] for each in panels(board)} == {
        identity for kind, identity in needed if kind == "panel"
    }
    assert {("grafana", "grafana"), ("datasource", "prometheus")} <= needed
    assert board["editable"]
    assert board["revision"] > 1


def test_the_file_is_named_by_the_uid_that_links_use():
    assert {uid: board["uid"] for uid, board in BOARDS.items()} == {uid: uid for uid in BOARDS}


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_panel_has_a_plain_type_and_a_description_that_begins_with_a_question(panel):
    question, question_mark, _rest = panel["description"].partition("?")

    assert question_mark, "the description begins with a question"
    assert question[0].isupper()
    assert ". " not in question, "the question comes first"
    assert panel["type"] in PLAIN


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_text_without_data_claims_nothing(panel):
    """Grafana shows it for a Prometheus or an exporter that does not answer, too."""
    text = panel["fieldConfig"]["defaults"].get("noValue", "No data")

    assert text.startswith("No data") or text == "not known"


@pytest.mark.parametrize("uid", BOARDS)
def test_every_query_uses_the_selected_data_source(uid: str):
    found = set(re.findall(r'"uid": "([^"]*)"', json.dumps(BOARDS[uid]["panels"])))

    assert found <= {"${datasource}"}
    assert BOARDS[uid]["templating"]["list"][0]["name"] == "datasource"


@pytest.mark.parametrize("uid", BOARDS)
def test_panels_do_not_overlap_and_fit_the_grid(uid: str):
    taken: dict[tuple[int, int], str] = {}
    for panel in BOARDS[uid]["panels"]:
        position = panel["gridPos"]
        assert position["x"] + position["w"] <= 24, panel["title"]
        for x in range(position["x"], position["x"] + position["w"]):
            for y in range(position["y"], position["y"] + position["h"]):
                assert (x, y) not in taken, f"{panel['title']} covers {taken[(x, y)]}"
                taken[(x, y)] = panel["title"]


@pytest.mark.parametrize("uid", BOARDS)
def test_ids_and_titles_of_panels_are_unique(uid: str):
    found = list(panels(BOARDS[uid]))

    assert len({panel["id"] for panel in found}) == len(found)
    assert len({panel["title"] for panel in found}) == len(found)


@pytest.mark.parametrize("uid", BOARDS)
def test_links_use_dashboards_and_variables_that_exist(uid: str):
    text = json.dumps(BOARDS[uid])
    for target, query in re.findall(r'"/d/([\w-]+)\?([^"]*)"', text):
        assert target in BOARDS
        variables = {each["name"] for each in BOARDS[target]["templating"]["list"]}
        assert set(re.findall(r"var-(\w+)=", query)) <= variables
        assert set(re.findall(r"\$\{(\w+):queryparam\}", query)) <= variables
        assert "${datasource:queryparam}" in query
        at_a_moment = "from=${__from}&to=${__value.time}" in query
        assert at_a_moment or "${__url_time_range}" in query


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_links_of_a_table_use_columns_that_it_has(panel):
    titles: set[str] = set()
    for step in panel.get("transformations", ()):
        titles |= set(step["options"].get("renameByName", {}).values())

    used = re.findall(r"__data\.fields\.(\w+)", json.dumps(panel))

    assert set(used) <= titles


@pytest.mark.parametrize("uid", BOARDS)
def test_links_encode_the_names_in_them(uid: str):
    """A component may be called "A & B", "50 %" or "#1"."""
    urls = " ".join(re.findall(r'"url": "([^"]*)"', json.dumps(BOARDS[uid])))
    used = re.findall(r"\$\{(__(?:data|field)\.[^}]*)\}", urls)

    plain = {each for each in used if not each.endswith(":percentencode")}
    assert plain <= {"__data.fields.Exporter"}  # HOST:PORT as Prometheus scrapes it: no name
    assert len(re.findall(r"__data\.fields\.Exporter", urls)) == urls.count("http://${__data")


@pytest.mark.parametrize("uid", BOARDS)
def test_variables_of_one_name_are_of_one_kind(uid: str):
    """Links and the menu pass them: several robots are no value of a variable that is one."""
    kinds = {
        (each["name"], other["name"])
        for each in BOARDS[uid]["templating"]["list"]
        for board in BOARDS.values()
        for other in board["templating"]["list"]
        if each["name"] == other["name"] and each.get("multi") != other.get("multi")
    }

    assert kinds == set()


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_timeline_has_the_colours_of_its_mappings(panel):
    """By thresholds Grafana merges the values by them, and every state has the lowest's colour."""
    if panel["type"] != "state-timeline":
        return
    defaults = panel["fieldConfig"]["defaults"]

    assert defaults["mappings"]
    assert defaults["color"]["mode"] == "fixed"
    assert "thresholds" not in defaults


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_number_without_data_is_on_no_colour(panel):
    """The lowest threshold's colour is also that of a panel without data."""
    if panel["type"] != "stat":
        return
    (lowest, *_rest) = panel["fieldConfig"]["defaults"]["thresholds"]["steps"]

    assert lowest["value"] is None
    assert lowest["color"] in {"text", "panel-bg"}


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_cell_without_a_value_is_on_no_colour(panel):
    """Grafana 12 would draw it in the colour of text: black in the light theme."""
    if panel["type"] != "table":
        return
    for override in panel["fieldConfig"]["overrides"]:
        look = {each["id"]: each["value"] for each in override["properties"]}
        if look.get("custom.cellOptions", {}).get("type") != "color-background":
            continue
        if override["matcher"]["options"] in {"severity", "Severity"}:  # a label: it has one always
            continue
        without = [
            each["options"]["result"]["color"]
            for each in look["mappings"]
            if each["type"] == "special" and each["options"]["match"].startswith("null")
        ]
        assert set(without) == {"panel-bg"}, override["matcher"]


@pytest.mark.parametrize("uid", BOARDS)
def test_the_sentences_of_the_banner_have_one_size(uid: str):
    """Else three are too small to be read, and one is the largest text of the page."""
    monitoring, data_as_of, *_others = BOARDS[uid]["panels"]

    assert monitoring["options"]["text"]["valueSize"] == 16
    assert monitoring["gridPos"]["h"] == data_as_of["gridPos"]["h"], "else the right is ragged"


@pytest.mark.parametrize("uid", BOARDS)
def test_every_dashboard_begins_with_the_state_of_the_monitoring(uid: str):
    monitoring, data_as_of, *_others = BOARDS[uid]["panels"]

    assert (monitoring["title"], data_as_of["title"]) == ("Monitoring", "Data as of")
    (dead,) = (
        each["options"]["result"]
        for each in monitoring["fieldConfig"]["defaults"]["mappings"]
        if each["type"] == "special"
    )
    assert dead["text"].startswith("Prometheus does not answer")


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_an_empty_table_shows_a_text_and_an_empty_cell_nothing(panel):
    if panel["type"] != "table":
        return
    columns: set[str] = set()
    for step in panel["transformations"]:
        columns |= set(step["options"].get("renameByName", {}).values())
    without_text = {
        override["matcher"]["options"]
        for override in panel["fieldConfig"]["overrides"]
        if {"id": "noValue", "value": ""} in override["properties"]
    }

    assert panel["fieldConfig"]["defaults"]["noValue"]
    assert columns == without_text


@pytest.mark.parametrize("panel", ALL_PANELS)
def test_a_table_is_sorted_by_columns_that_it_shows(panel):
    """Grafana ignores the sort by a hidden one."""
    hidden = {
        override["matcher"]["options"]
        for override in panel["fieldConfig"]["overrides"]
        if {"id": "custom.hidden", "value": True} in override["properties"]
    }
    sorted_by = {each["displayName"] for each in panel["options"].get("sortBy") or ()}

    assert not sorted_by & hidden


def shown_unit(unit: str) -> str:
    return {"degC": "°C", "degF": "°F"}.get(unit, unit)


def test_a_value_is_shown_in_the_unit_of_its_legend():
    from fleet_dashboards.lib import palette

    (graph,) = (p for p in panels(BOARDS["ros-diagnostics-robot"]) if p["title"] == "Temperatures")
    shown = {
        override["matcher"]["options"]: override["properties"][0]["value"]
        for override in graph["fieldConfig"]["overrides"]
        if override["properties"][0]["id"] == "unit"
    }

    for unit, wanted in palette.UNITS.items():
        found = [
            grafana_unit
            for regexp, grafana_unit in shown.items()
            if re.search(regexp.strip("/"), f"Motor 1: Temperature in {shown_unit(unit)}")
        ]
        assert found == [wanted]


def test_a_panel_is_repeated_for_each_unit_but_temperatures():
    (unit,) = (
        variable
        for variable in BOARDS["ros-diagnostics-robot"]["templating"]["list"]
        if variable["name"] == "unit"
    )
    repeated = re.compile(unit["regex"].strip("/"))

    assert [each for each in ("%", "V", "degC", "degF", "K", "kB", "") if repeated.match(each)] == [
        *("%", "V", "kB")
    ]


def test_links_between_dashboards_keep_variables_and_time_range():
    for board in BOARDS.values():
        (link,) = board["links"]
        assert link["includeVars"]
        assert link["keepTime"]
        assert set(link["tags"]) <= set(board["tags"])
