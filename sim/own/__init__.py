"""A task of one file: the decorator, and the simulators that it may use.

`adaptsim` (the module at the top) re-exports all of it.
"""
