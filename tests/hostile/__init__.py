"""Hostile input: what anybody may send or hand over, mutated, and what comes of it."""
