"""Tests of fleet.study_report."""
