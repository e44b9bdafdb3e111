"""What a study shows, as one HTML page and as figures for a paper."""
