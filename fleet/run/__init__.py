"""Runs: the range, its clocks and buses; the only package that imports agents and coordinator."""
