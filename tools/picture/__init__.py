"""The picture of the README: a run from above, its altitudes and its separations."""
