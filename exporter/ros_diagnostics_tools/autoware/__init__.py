"""Autoware's diagnostic graph -> capabilities, each unit accounted for.

`graph` reads the files, `names` finds names that people read, `convert` translates.
"""
