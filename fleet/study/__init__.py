"""Studies: many runs in memory over factors, and statistics of what came of them."""
