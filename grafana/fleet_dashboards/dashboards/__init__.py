"""The dashboards: one module each, with their panels and the PromQL of each panel."""
