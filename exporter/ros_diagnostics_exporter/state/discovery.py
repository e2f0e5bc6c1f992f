"""From a topic that a pattern matches to a robot. Pure: knows no graph and no time."""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Discovery, Robot, topics_of


def _wants(discovery: Discovery, name: str) -> bool:
    """Whether the include and exclude patterns let a robot of this name in."""
    if any(pattern.fullmatch(name) for pattern in discovery.exclude):
        return False
    included = discovery.include
    return not included or any(pattern.fullmatch(name) for pattern in included)


def robot_name(discovery: Discovery, topic: str, domain_id: int) -> str | None:
    """The name of the robot behind a topic; None where the discovery does not want it."""
    match = discovery.pattern.fullmatch(topic)
    if match is None or domain_id not in discovery.domain_ids:
        return None
    matched = match.groupdict().get("robot") or ""
    name = _fill(discovery.name, matched, domain_id)
    return name if _wants(discovery, name) else None


def found_robot(discovery: Discovery, name: str, topic: str, domain_id: int) -> Robot:
    """The robot of this name behind a topic; its other topic stands beside it."""
    aggregate, raw = topics_of(topic, discovery.source)
    address = discovery.address
    return Robot(
        name=name,
        domain_id=domain_id,
        namespace=topic.rpartition("/")[0],
        topic_agg=aggregate,
        topic_raw=raw,
        source=discovery.source,
        profile=discovery.profile,
        address=None if address is None else _fill(address, name, domain_id),
        labels=discovery.labels,
    )


def _fill(template: str, robot: str, domain_id: int) -> str:
    return template.replace("{robot}", robot).replace("{domain_id}", str(domain_id))
