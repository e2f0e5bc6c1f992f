"""The processes around the exporter in `bench.hostile` and `bench.dds`: a fleet, attackers.

Each is a process of its own (`python -m bench.actors fleet|taker|arrays|readers`), which ends after
a given time and writes once a second to standard output what it has done so far.
"""
