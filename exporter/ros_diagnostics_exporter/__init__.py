"""Prometheus exporter for the diagnostics of a fleet of ROS 2 robots."""

__version__ = "0.2.0"
