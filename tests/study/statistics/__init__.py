"""Tests of fleet.study.statistics."""
