"""Scenarios: schema, packaged TOML, how they are loaded and checked, generated traffic."""
