"""The log: MCAP in and out."""
