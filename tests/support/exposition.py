"""What an exporter serves at /metrics."""

from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.samples import Sample

from testbed import http


def parsed(text: str, name: str = "", **labels: str) -> list[Sample]:
    """The samples of ros_diagnostics_``name``, of all without a name, with these labels."""
    return [
        sample
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if (not name or sample.name == f"ros_diagnostics_{name}")
        and labels.items() <= sample.labels.items()
    ]


def samples(address: str, name: str = "", **labels: str) -> list[Sample]:
    """Those of a scrape of HOST:PORT.

    Raises:
        http.Unanswered: The exporter does not answer.
    """
    return parsed(http.get(address, "/metrics", 60).decode(), name, **labels)


def value(address: str, name: str, **labels: str) -> float | None:
    """The value of the only such sample; None where there is none."""
    found = samples(address, name, **labels)
    assert len(found) <= 1, found
    return found[0].value if found else None
