"""Experiments on this machine: what monitoring costs and how soon it notifies, as tables and plots.

`./run experiment` lists them; `./run soak` runs for hours.
"""
