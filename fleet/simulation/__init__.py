"""A run: conductors of both clocks, processes and their lifecycle, live faults, recording."""
