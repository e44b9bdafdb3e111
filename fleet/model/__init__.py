"""The pure model: flight, trajectories, risk, groups and the scenario. No I/O, no clock."""
