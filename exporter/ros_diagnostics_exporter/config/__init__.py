"""Reads fleet.yml and its folders into one frozen Fleet, again when a file changes.

Knows neither ROS nor HTTP, and of the other packages only value types.
"""
