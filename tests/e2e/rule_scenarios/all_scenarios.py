"""All rule scenarios; they run at the same time, each on its own robots."""

from e2e.rule_scenarios.components import COMPONENTS, VALUES
from e2e.rule_scenarios.robots import FLEETS, NETWORK, ROBOTS

SCENARIOS = (*COMPONENTS, *VALUES, *ROBOTS, *NETWORK, *FLEETS)
