"""What is wrong: problems, when they are confirmed, why they are suppressed, when they end.

Owns every decision between a level, value or silence and a fault that is served. Driven by events
and timers: `now` is an argument, changes are returned, and nothing here does input or output.
"""
