"""The UAV: flight, obedience to commands, and resolution when it is elected."""
