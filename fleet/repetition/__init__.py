"""A run flown again: its log tick by tick, and what differs in the repetition."""
