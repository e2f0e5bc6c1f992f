"""The fleet as a discrete simulation, on a clock of its own."""
