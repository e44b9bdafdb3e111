"""How a UAV flies, how it is guided, and how its flight is predicted."""
