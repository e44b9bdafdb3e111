"""A UAV that is flown elsewhere: one of the fleet's own processes, which asks a foreign program."""
