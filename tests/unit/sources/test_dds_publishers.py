"""Who published a message, as long as the graph names publishers as the messages do."""

from unittest.mock import Mock

from ros_diagnostics_exporter.model import Endpoint
from ros_diagnostics_exporter.sources.dds import MOST_STRANGE, DdsDomain
from ros_diagnostics_exporter.sources.dds_subscription import Taken

MINE, OTHER = (Taken(b"", 1, 1, 1, publisher) for publisher in ("mine", "other"))


def looked(looks: int, *writers: str) -> DdsDomain:
    """A domain that has received a message of one publisher, after looks that show these."""
    domain = DdsDomain(0, (), Mock(), Mock(), 1.0)
    domain.measure(Mock(), MINE)
    for _ in range(looks):
        domain._find_publisher({"/r/diagnostics": Endpoint(1, writers=frozenset(writers))})
    return domain


def test_publishers_have_no_names_where_the_graph_has_others_for_long():
    assert looked(MOST_STRANGE - 2, "other").publisher(MINE) == "mine"
    domain = looked(MOST_STRANGE, "other")
    assert (domain.publisher(MINE), domain.publisher(OTHER)) == ("", "")


def test_they_keep_them_once_the_graph_has_had_one():
    domain = looked(1, "mine")
    for _ in range(2 * MOST_STRANGE):
        domain._find_publisher({})
    assert domain.publisher(OTHER) == "other"
