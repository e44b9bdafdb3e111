"""The coordinator: finds conflict groups and elects their computing UAVs."""
