"""The processes around the exporter in `bench.hostile`, `bench.dds` and `bench.zenoh`.

Each is a process of its own (`python -m bench.actors --help`), which ends after a given time and
writes to standard output what it has done so far.
"""
