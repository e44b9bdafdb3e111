"""The vehicle models, one module each, with all that the project knows of it.

The registry finds the modules by itself; see docs/extending/vehicle.md.
"""
