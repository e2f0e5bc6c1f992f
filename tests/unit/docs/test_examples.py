"""Every code block of the pages is tried here; examples.yml has what others run and what none."""

import re
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

from config_schema import schema
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from support.called import called
from support.shipped_rules import ROOT, run_tool

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted({*(ROOT / "docs").glob("*.md")} - {ROOT / "docs" / "CHANGELOG.md"}),
    *sorted((ROOT / "docs" / "alerts").glob("*.md")),
]
BLOCK = re.compile(r"^( *)```(\w*)\n(.*?)^ *```|^#+ ([^\n]*)$", re.DOTALL | re.MULTILINE)
LISTED = yaml.safe_load((Path(__file__).parent / "examples.yml").read_text("utf-8"))
SCHEMA = schema(Fleet)
OF_PROFILE = {*SCHEMA["definitions"]["Profile"]["properties"]}
BIN = Path(sysconfig.get_path("scripts"))
# `ros-diagnostics` itself, which has subcommands, is in test_commands.py.
OURS = ("ros-diagnostics-exporter", "virtual-robots", "./run")
CALL = re.compile(rf"^(?:\$ |exec )?(ros-diagnostics|{'|'.join(OURS)})(?= |$)(.*)")


class Example(NamedTuple):
    page: str
    heading: str
    language: str
    text: str

    @property
    def keys(self) -> tuple[str, ...]:
        """What may name it in examples.yml, the most exact first."""
        return f"{self.page}#{self.heading}", self.page, self.page.rpartition("/")[0]


def examples() -> Iterator[Example]:
    for page in PAGES:
        heading = ""
        for indent, language, text, title in BLOCK.findall(page.read_text("utf-8")):
            heading = title or heading
            if not title:
                lines = [each.removeprefix(indent) for each in text.splitlines(keepends=True)]
                name = str(page.relative_to(ROOT))
                yield Example(name, heading, language, "".join(lines))


EXAMPLES = list(examples())


def data_of(example: Example) -> Any:
    return yaml.safe_load(example.text) if example.language == "yaml" else None


def fleet_of(example: Example) -> dict[str, Any] | None:
    """A whole fleet.yml with the block; None where it is no part of one."""
    data = data_of(example)
    if isinstance(data, list) and all("expr" in each and "component" in each for each in data):
        data = {"queries": data}
    if not isinstance(data, dict) or not data:
        return None
    if data.keys() <= OF_PROFILE - {"capabilities"}:
        data = {"profiles": {"default": data}}
    if not data.keys() <= {*SCHEMA["properties"]}:
        return None
    before = {}
    if "capabilities" in data:  # of the fleet, of robots that the page has defined before
        before = data_of(next(each for each in EXAMPLES if each.page == example.page))
    return {"fleet": "f", **before, **data}


def prometheus_of(example: Example) -> dict[str, Any] | None:
    """A whole prometheus.yml with the block; None where it is no part of one."""
    data = data_of(example)
    if isinstance(data, list) and "job_name" in data[0]:
        data = {"scrape_configs": data}
    is_part = isinstance(data, dict) and "scrape_configs" in data
    return data if is_part else None


def calls_of(example: Example) -> list[tuple[str, str]] | None:
    """Our commands with their arguments; None where a line of it is another's."""
    if example.language not in {"sh", "console"}:
        return None
    lines = [each for each in example.text.replace("\\\n", " ").splitlines() if each]
    if any(each.startswith("$ ") for each in lines):
        lines = [each for each in lines if each.startswith("$ ")]  # the others are output
    found = [CALL.match(line) for line in lines]
    return [(each[1], each[2]) for each in found if each] if all(found) else None


def is_tried(example: Example) -> bool:
    return (
        example.language == "promql"
        or fleet_of(example) is not None
        or prometheus_of(example) is not None
        or any("record" in each for each in data_of(example) or () if isinstance(each, dict))
        or calls_of(example) is not None
    )


def named(parametrized: list[Example]) -> Any:
    return pytest.mark.parametrize("example", parametrized, ids=lambda each: each.keys[0])


def test_every_block_is_tried_or_listed():
    listed = {**LISTED["run"], **LISTED["not_run"]}

    assert len(EXAMPLES) > 150
    assert not [
        each.keys[0] for each in EXAMPLES if not is_tried(each) and not listed.keys() & {*each.keys}
    ]


def test_what_is_listed_is_there():
    blocks = {key for each in EXAMPLES for key in each.keys}

    assert {*LISTED["run"], *LISTED["not_run"]} - blocks == set()
    assert not [test for test in LISTED["run"].values() if not (ROOT / test).exists()]


@named([each for each in EXAMPLES if fleet_of(each) is not None])
def test_a_part_of_fleet_yml_is_accepted(example: Example, tmp_path: Path):
    (tmp_path / "fleet.yml").write_text(yaml.safe_dump(fleet_of(example)))

    assert load(tmp_path / "fleet.yml").name


@named([each for each in EXAMPLES if prometheus_of(each) is not None])
def test_a_part_of_prometheus_yml_is_accepted(example: Example, tmp_path: Path):
    file = tmp_path / "prometheus.yml"
    file.write_text(yaml.safe_dump(prometheus_of(example)))

    run_tool("promtool", "check", "config", "--syntax-only", file)


def test_every_query_and_rule_is_accepted(tmp_path: Path):
    """A runbook has a query on each line."""
    queries = [
        query
        for each in EXAMPLES
        if each.language == "promql"
        for query in (each.text.splitlines() if "/alerts/" in each.page else [each.text])
    ]
    rules = [{"record": f"page:query:n{n}", "expr": query} for n, query in enumerate(queries)]
    for each in EXAMPLES:
        data = data_of(each)
        rules += data if isinstance(data, list) and "record" in data[0] else []
    file = tmp_path / "rules.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "pages", "rules": rules}]}))

    assert len(rules) > len(queries) > 50
    assert f"SUCCESS: {len(rules)} rules found" in run_tool("promtool", "check", "rules", file)


@cache
def usage(program: str) -> str:
    argv = [str(ROOT / "run"), "help"] if program == "./run" else [str(BIN / program), "--help"]
    if program == "virtual-robots":  # of each subcommand, too
        argv = ["sh", "-c", f"for each in '' fault record replay; do {argv[0]} $each --help; done"]
    return called(argv, cwd=ROOT).stdout


def ours() -> list[tuple[str, str]]:
    found = {call for each in EXAMPLES for call in map(CALL.match, each.text.splitlines()) if call}
    return sorted({(each[1], each[2].partition("#")[0]) for each in found if each[1] in OURS})


@pytest.mark.parametrize(("program", "arguments"), ours())
def test_a_command_has_these_flags(program: str, arguments: str):
    flags = re.findall(r"(?<!\S)--[a-z.-]+", arguments)
    if program == "./run":  # benches and experiments have flags of their own
        assert re.search(rf"^  {arguments.split(maxsplit=1)[0]}\b", usage(program), re.MULTILINE)
        return
    assert not [flag for flag in flags if not re.search(rf"{flag}\b", usage(program))]
