"""The files that describe virtual robots: kinds, scenarios, the thesis' settings."""
