"""Packaged scenarios, as TOML beside this file."""
