"""Encounters that a study draws: one module a kind."""
