"""One participant: its node, and what runs it."""
