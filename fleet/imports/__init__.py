"""Encounters of other programs as scenarios: BlueSky, DAIDALUS, recorded flights in CSV."""
