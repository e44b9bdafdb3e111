"""Tests of `fleet.relay`."""
