"""Tracks, risk and conflict groups."""
