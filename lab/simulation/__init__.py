"""Years of a fleet in minutes: seeded histories through the real state and judgement of faults.

Everything is slower than in a real fleet by a factor of 600: a robot publishes every ten minutes
instead of once a second, and all settings are as much longer. What is judged is the same.
"""
