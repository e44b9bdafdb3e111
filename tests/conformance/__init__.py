"""The conformance test for foreign UAVs."""
