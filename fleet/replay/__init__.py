"""Replaying a log on zenoh, and comparing a repeated run with its log."""
