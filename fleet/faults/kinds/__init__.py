"""The kinds of faults, one module each, with all that the project knows of it.

The registry finds the modules by itself; see docs/extending/fault.md.
"""
