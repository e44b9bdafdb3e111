"""How messages travel: over zenoh."""
