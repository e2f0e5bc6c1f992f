"""On call: who is notified when, from a file; built into a configuration of Alertmanager."""
