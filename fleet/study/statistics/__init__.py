"""Statistics of studies, pure: arrays in, small frozen results out (docs/statistics.md)."""
