"""The pure model: vehicle, conflict and elections. No I/O, no clock."""
