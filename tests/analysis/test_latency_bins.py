"""Bins of latencies: exact where it matters, and no more of them however long a run is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.analysis.latency_bins import LATENCY_BIN_NS, latency_bin

MS = 1_000_000


@given(st.integers(-(2**63), 2**63))
def test_a_latency_is_in_its_bin_to_four_digits(latency_ns: int) -> None:
    edge_ns = latency_bin(latency_ns) * LATENCY_BIN_NS
    assert 0 <= latency_ns - edge_ns < max(LATENCY_BIN_NS, abs(latency_ns) * 1.001e-3)


@given(st.integers(0, 9999), st.integers(0, 9))
def test_four_digits_are_kept(digits: int, zeros: int) -> None:
    """What a scenario adds as a latency is told as it is."""
    units = digits * 10**zeros
    assert latency_bin(units * LATENCY_BIN_NS) == units


@pytest.mark.parametrize(("until_ns", "most"), [(100 * MS, 10_000), (60_000 * MS, 35_000)])
def test_bins_are_limited_in_number(until_ns: int, most: int) -> None:
    assert len({latency_bin(ns) for ns in range(0, until_ns, 4000)}) <= most
