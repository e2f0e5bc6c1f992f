"""The names that the config reserves agree with the table of the metrics."""

from ros_diagnostics_exporter.config.metric_names import RESERVED_METRIC_PREFIXES
from ros_diagnostics_exporter.config.scalars import RESERVED_LABELS
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES


def test_every_label_of_robot_info_and_of_components_is_reserved():
    assert {*metrics.ROBOT_INFO.labels, *metrics.COMPONENT} <= RESERVED_LABELS


def test_no_family_can_be_the_metric_of_a_value():
    assert all(each.name.startswith(RESERVED_METRIC_PREFIXES) for each in ALL_FAMILIES)
