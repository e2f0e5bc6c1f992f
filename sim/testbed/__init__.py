"""Starts servers and programs for the demo, the end-to-end tests and the benches.

Processes, ports, ROS domains, polling, HTTP, mail, configuration and its clocks, the whole stack.
"""
