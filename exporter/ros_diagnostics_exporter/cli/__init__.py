"""The commands: the exporter itself, status, check_nagios and ack."""
