"""What a run meant: separation, tallies, reports."""
