"""The same histories of results through Nagios and through this project, and what they notify."""
