"""A page in the browser on which a run is watched, disturbed and paced, or a log looked at."""
