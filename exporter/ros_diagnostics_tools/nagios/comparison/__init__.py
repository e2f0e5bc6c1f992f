"""Nagios' log beside the exporter's record of notifications: where both notified differently.

`log` reads what Nagios notified, `here` what was notified here, in Nagios' terms; `differences`
compares them. Used by `ros-diagnostics-compare` only.
"""
