"""What was received: robots, components, values, staleness, conditions. No I/O and no lock."""
