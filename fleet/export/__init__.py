"""A log as other people's programs take it: Foxglove, Lichtblick, rerun, tables."""
