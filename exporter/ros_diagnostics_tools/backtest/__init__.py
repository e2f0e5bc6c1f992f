"""Judges recorded diagnostics as the running exporter would have: bags in, faults and advice out.

Messages go through the very same state and judgement of faults, with the recording's time instead
of the clock's.
"""
