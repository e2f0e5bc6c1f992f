"""What the variables offer to choose from."""

from __future__ import annotations

_INFO = "robot:ros_diagnostics:info"

FLEETS = f"label_values({_INFO}, fleet)"
SITES = f'label_values({_INFO}{{fleet=~"$fleet"}}, site)'
ROBOT_GROUPS = f'label_values({_INFO}{{fleet=~"$fleet"}}, robot_group)'
ROBOTS = f'label_values({_INFO}{{fleet=~"$fleet"}}, robot)'
COMPONENTS_OF_ROBOT = (
    'label_values(component:ros_diagnostics_state:rank{fleet=~"$fleet", robot="$robot"}, component)'
)
COMPONENTS_OF_FLEET = (
    'label_values(component:ros_diagnostics_state:rank{fleet=~"$fleet"}, component)'
)
KEYS = 'label_values(ros_diagnostics_component_value{fleet=~"$fleet", component="$component"}, key)'
UNITS = 'label_values(ros_diagnostics_component_value{fleet=~"$fleet", robot="$robot"}, unit)'
# Temperatures have a panel of their own, in front.
UNITS_WITHOUT_PANEL = r"/^(?!(?:degC|degF|K)$).+/"
