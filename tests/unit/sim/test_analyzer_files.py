"""What the real aggregator rejects, aborts on or ignores is a clear error here."""

from pathlib import Path

import pytest

from virtual_robots.aggregator import Aggregator, AnalyzerConfigError, load_parameters

GENERIC = "type: diagnostic_aggregator/GenericAnalyzer"


def aggregator(folder: Path, text: str, version: str = "4.2.7") -> Aggregator:
    path = folder / "diagnostics.yaml"
    path.write_text(text)
    return Aggregator(load_parameters(path), 0.0, version)


def parameters(body: str) -> str:
    return f"analyzers:\n  ros__parameters:\n    {body}\n"


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (f"m: {{{GENERIC}, path: M, contains: Motor}}", "m.contains: is 'Motor', must be a list"),
        (f"m: {{{GENERIC}, path: M, contains: []}}", "m.contains: has no value"),
        (f"m: {{{GENERIC}, path: 7, contains: [M]}}", "m.path: is 7, must be a string"),
        (f"m: {{{GENERIC}, path: M, contains: [M], num_items: 2.0}}", "num_items: is 2.0, must be"),
        (f"m: {{{GENERIC}, path: M, contains: [M], discard_stale: 1}}", "discard_stale: is 1,"),
        (f"m: {{{GENERIC}, path: M, regex: ['Joint [']}}", "m.regex: 'Joint [' is no regular"),
        ("pub_rate: 0.0", "pub_rate: is 0.0, must be above 0.0"),
        ("critical: 'true'", "critical: is 'true', must be true or false"),
    ],
)
def test_a_value_that_aborts_the_real_one_names_file_and_key(tmp_path, body, what):
    with pytest.raises(AnalyzerConfigError) as caught:
        aggregator(tmp_path, parameters(body))
    assert str(caught.value).startswith(f"{tmp_path / 'diagnostics.yaml'}: ")
    assert what in str(caught.value)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("power: {}\n", "has no section for the node 'analyzers'; write 'analyzers:' or '/**:'"),
        ("analyzers:\n  motor: {}\n", "analyzers: 'ros__parameters:' is missing under it"),
        ("- a\n", "must be a mapping that begins with 'analyzers:'"),
        ("analyzers: [\n", "is not YAML"),
    ],
)
def test_a_file_that_the_real_one_ignores_is_rejected(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(AnalyzerConfigError, match=r"diagnostics\.yaml: ") as caught:
        aggregator(tmp_path, text)
    assert what in str(caught.value)


@pytest.mark.parametrize("header", ["analyzers:", "/analyzers:", "/**:", "/**/analyzers:"])
def test_each_header_that_ros_knows_is_read(tmp_path: Path, header: str) -> None:
    text = f"{header}\n  ros__parameters:\n    m: {{{GENERIC}, path: M, contains: [x]}}\n"
    assert [s.name for s in aggregator(tmp_path, text).publish(0.0).statuses] == ["/M"]


def test_a_node_below_a_namespace_is_read(tmp_path: Path) -> None:
    text = "/**:\n  analyzers:\n    ros__parameters:\n      path: Robot\n"
    assert aggregator(tmp_path, text).publish(0.0).statuses[0].name == "/Robot"


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (f"m: {{{GENERIC}, path: M, name: [x]}}", "'name' and 'expected' alone match nothing"),
        ("m: {type: GenericAnalyzer, path: M}", "m: 'GenericAnalyzer' is none of diagnostic_"),
        (f"m: {{{GENERIC}, contains: [M]}}", "m: has no path and so shows nothing"),
        (
            (
                f"g: {{type: diagnostic_aggregator/AnalyzerGroup, path: G, analyzers: "
                f"{{m: {{{GENERIC}, path: M}}}}}}"
            ),
            "g.analyzers.m: is rejected by the real diagnostic_aggregator",
        ),
    ],
)
def test_an_analyzer_that_the_real_one_runs_without_is_a_warning(tmp_path, body, what):
    warnings = aggregator(tmp_path, parameters(body)).warnings
    assert any(what in text for text in warnings), warnings


def test_a_version_that_is_not_known_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(AnalyzerConfigError, match=r"'4\.0\.0' is not one of 4\.2\.7, 4\.2\.6"):
        aggregator(tmp_path, parameters("path: R"), "4.0.0")
