"""Tests of repetition."""
