"""All stories: they are played at the same time, on robots of their own."""

from __future__ import annotations

from e2e.rule_scenarios.components import COMPONENTS, VALUES
from e2e.rule_scenarios.robots import FLEETS, NETWORK, ROBOTS

STORIES = (*COMPONENTS, *VALUES, *ROBOTS, *NETWORK, *FLEETS)
