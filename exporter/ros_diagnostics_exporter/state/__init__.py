"""What is known about the robots: levels, values, ages; and the file that outlives a restart.

Pure functions of messages, config and time: no ROS, no HTTP, no Prometheus. See ``state.State``.
"""
