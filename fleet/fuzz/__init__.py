"""Simulation testing: random encounters under random faults, each checked by the invariants."""
