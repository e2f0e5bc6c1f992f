"""The lock and what it protects: the robot registry, and what connects robots to faults."""
