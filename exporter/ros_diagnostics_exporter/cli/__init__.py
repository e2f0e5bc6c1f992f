"""The command line of the exporter: its flags, and what starts and stops it."""
