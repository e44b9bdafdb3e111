"""Range faults: each model against its formula, and presets against what they promise."""

from __future__ import annotations

import math
import statistics
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.faults.draws import LinkMessage
from fleet.faults.kinds.range import Range
from fleet.faults.presets import PRESETS
from fleet.faults.rules import Rule
from tests.support.fault_samples import (
    MANY,
    TICK_NS,
    channel,
    fast,
    lost,
    stream,
    within_99_percent,
)

RADIO = Range(model="log_distance")
FADES = Range(model="rayleigh", scale_m=800.0)
WIFI = Range(model="polynomial", quadratic_per_m2=5.335e-7, linear_per_m=3.395e-5)


def rate(rule: Rule, distance_m: float, bits: int = 0, count: int = MANY) -> float:
    """How much of what is sent over this distance is lost."""
    return sum(lost(channel(rule), stream(count, bits=bits, distance_m=distance_m))) / count


def test_a_cutoff_is_sharp() -> None:
    rule = Range(model="cutoff", max_m=5000.0)
    assert [rate(rule, d, count=MANY // 4) for d in (0.0, 5000.0, 5000.001, 1e6)] == [0, 0, 1, 1]


@pytest.mark.parametrize("rule", [RADIO, FADES, WIFI])
def test_a_greatest_distance_cuts_every_model_off(rule: Range) -> None:
    near = msgspec.structs.replace(rule, max_m=0.5)
    assert (rate(near, 0.5, count=100), rate(near, 0.51, count=100)) == (0.0, 1.0)


@pytest.mark.parametrize("distance_m", [100.0, 500.0, 800.0, 1500.0])
def test_rayleigh_receives_by_exp_of_the_square(distance_m: float) -> None:
    received = math.exp(-((distance_m / 800.0) ** 2))
    assert within_99_percent(rate(FADES, distance_m), 1.0 - received)


@pytest.mark.parametrize("distance_m", [100.0, 400.0, 1000.0, 1300.0, 1340.0, 1e5])
def test_a_polynomial_loses_by_its_formula_up_to_everything(distance_m: float) -> None:
    loss = min(1.0, 5.335e-7 * distance_m**2 + 3.395e-5 * distance_m)
    assert within_99_percent(rate(WIFI, distance_m), loss)


def test_path_loss_bit_errors_and_size_make_the_loss() -> None:
    rule = msgspec.structs.replace(RADIO, power_dbm=10.0, exponent=2.7, floor_dbm=-200.0)
    for distance_m in (80.0, 120.0, 140.0, 500.0):
        snr_db = 10.0 - (40.0 + 27.0 * math.log10(distance_m)) + 95.0
        # erfc(x) / 2 is the chance that a standard normal number is above x sqrt(2).
        bit_error = statistics.NormalDist().cdf(-math.sqrt(2.0 * 10.0 ** (snr_db / 10.0)))
        for bits in (1, 100, 2000):
            expected = 1.0 - (1.0 - bit_error) ** bits
            assert rule.loss(distance_m, bits) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert 0.7 < rule.loss(140.0, 2000) < 0.8
    assert within_99_percent(rate(rule, 140.0, 2000), rule.loss(140.0, 2000))


def test_below_the_floor_nothing_is_received() -> None:
    edge_m = 10.0 ** ((20.0 - 40.0 + 90.0) / 20.0)
    assert (RADIO.loss(0.999 * edge_m), RADIO.loss(1.001 * edge_m)) == (0.0, 1.0)
    assert RADIO.loss(0.0, 1000) == RADIO.loss(1.0, 1000)  # the reference is at 1 m


def test_shadowing_is_normal_and_lasts_for_a_second_in_both_directions() -> None:
    rule = msgspec.structs.replace(RADIO, shadowing_db=6.0)
    at_m = 10.0 ** ((20.0 - 40.0 + 90.0 - 3.0) / 20.0)  # 3 dB above the floor
    found = channel(rule)
    sent = [LinkMessage(1, 2, "adsb", n, n * 1_000_000_000, 0, at_m) for n in range(MANY)]
    gone = lost(found, sent)
    assert within_99_percent(sum(gone) / MANY, statistics.NormalDist(0.0, 6.0).cdf(-3.0))
    for n, flag in enumerate(gone[:2000]):
        there = LinkMessage(1, 2, "ack", n, n * 1_000_000_000 + 9 * TICK_NS, 0, at_m)
        back = LinkMessage(2, 1, "cmd", n, n * 1_000_000_000 + 5 * TICK_NS, 0, at_m)
        assert lost(found, [there, back]) == [flag, flag]
    other = lost(found, [msgspec.structs.replace(link_message, dst=3) for link_message in sent])
    both = sum(a and b for a, b in zip(gone, other, strict=True)) / MANY
    assert within_99_percent(both, (sum(gone) / MANY) * (sum(other) / MANY))


def test_who_has_no_place_is_not_heard() -> None:
    for rule in (Range(max_m=1.0), RADIO, FADES, WIFI):
        assert all(lost(channel(rule), stream(MANY // 4)))


@pytest.mark.parametrize("rule", [Range(max_m=900.0), FADES, WIFI])
def test_what_is_lost_nearby_is_lost_further_away_too(rule: Range) -> None:
    dropped: list[set[int]] = []
    for distance_m in (10.0, 300.0, 600.0, 900.0, 1200.0, 5000.0):
        flags = lost(channel(rule), stream(5000, distance_m=distance_m))
        dropped.append({n for n, gone in enumerate(flags) if gone})
    assert all(near <= far for near, far in pairwise(dropped))
    assert len(dropped[0]) < 200
    assert len(dropped[-1]) == 5000


@given(st.floats(1.0, 2000.0), st.floats(0.0, 30.0), st.floats(0.0, 30.0))
@fast
def test_what_more_power_loses_less_power_loses_too(
    distance_m: float, one_dbm: float, other_dbm: float
) -> None:
    weak, strong = (
        lost(
            channel(msgspec.structs.replace(RADIO, power_dbm=p, shadowing_db=4.0)),
            stream(50, bits=800, distance_m=distance_m),
        )
        for p in sorted((one_dbm, other_dbm))
    )
    assert all(a >= b for a, b in zip(weak, strong, strict=True))


def test_only_range_rules_ask_for_distances() -> None:
    assert channel(RADIO).measures_distance
    assert channel(msgspec.structs.replace(RADIO, start_s=9.0)).measures_distance
    assert not channel(*PRESETS["bursty"](0.2)).measures_distance


# presets


@pytest.mark.parametrize("broadcast_s", [0.2, 0.5, 1.0, 3.0])
def test_adsb_receives_a_broadcast_so_that_95_percent_come_within_3_s(broadcast_s: float) -> None:
    (rule,) = PRESETS["adsb"](broadcast_s)
    gone = sum(lost(channel(rule), stream(distance_m=18_520.0))) / MANY
    assert within_99_percent(gone, 0.05 ** (broadcast_s / 3.0))
    assert not rule.concerns(LinkMessage(1, 2, "cmd", 0, 0))


def test_adsb_brings_an_update_within_3_s_at_10_nautical_miles() -> None:
    flags = lost(channel(*PRESETS["adsb"](0.5)), stream(6 * 20_000, distance_m=18_520.0))
    updated = [not all(flags[n : n + 6]) for n in range(0, len(flags), 6)]
    assert within_99_percent(sum(updated) / 20_000, 0.95, 20_000)


def test_the_other_presets_are_what_they_say() -> None:
    assert PRESETS["perfect"](0.2) == []
    (wifi,), (fades,), (bursty,) = (PRESETS[n](0.2) for n in ("wifi", "rayleigh", "bursty"))
    assert within_99_percent(rate(wifi, 1000.0), 0.5335 + 0.03395)
    assert rate(wifi, 1340.0, count=1000) == 1.0
    assert within_99_percent(rate(fades, 1000.0), 1.0 - math.exp(-1.0))
    assert sum(lost(channel(bursty), stream())) / MANY == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(
    ("name", "within"),
    [("adsb_latency", {1.2: 0.95}), ("network_remote_id", {1.0: 0.95, 3.0: 0.99})],
)
def test_presets_of_latency_are_as_late_as_their_standards_allow(
    name: str, within: dict[float, float]
) -> None:
    (rule,) = PRESETS[name](1.0)
    judge = channel(rule)
    delays = [judge.fate(sent).deliveries[0].delay_ns / 1e9 for sent in stream()]
    for bound_s, share in within.items():
        assert within_99_percent(sum(d <= bound_s for d in delays) / MANY, share)
    assert not rule.concerns(LinkMessage(1, 2, "cmd", 0, 0))
