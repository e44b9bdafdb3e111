"""Tests of fleet.study."""
