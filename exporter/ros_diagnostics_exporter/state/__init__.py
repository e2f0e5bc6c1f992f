"""The one mutable room: robots, components, time. Told and asked, it never asks back.

Knows neither ROS nor HTTP nor Prometheus. ``fleet.State`` is its door.
"""
