"""Watched from update to update, the pairs at risk are those that a search finds afresh."""

from __future__ import annotations

import random
from collections.abc import Collection, Sequence

import pytest

from fleet.model.conflict import watch
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required
from fleet.model.conflict.tracks import StateReport
from fleet.model.conflict.watch import ConflictWatch
from fleet.model.conflict.witness import is_deep
from fleet.model.types import Pair
from fleet.model.units import to_ns
from tests.model.test_detection import NOW_NS, OUTLOOK, craft, scene

STEP_NS = to_ns(0.4)


@pytest.mark.parametrize("count", [6, 16])
def test_the_pairs_are_those_of_a_new_search(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody reports something else in every update, and somebody is not heard of."""
    spared: list[int] = []

    def searched(
        reports: Sequence[StateReport],
        now_ns: int,
        outlook: Outlook,
        *,
        sure: Collection[Pair] = (),
    ) -> dict[Pair, float]:
        spared.append(len(sure))
        return conflicts(reports, now_ns, outlook, sure=sure)

    monkeypatch.setattr(watch, "conflicts", searched)
    rng, found = random.Random(count), 0
    for seed in range(6):
        kept, reports = ConflictWatch(OUTLOOK), scene(seed, count, 1500.0)
        for step in range(12):
            now_ns = NOW_NS + step * STEP_NS
            changed = rng.randrange(count)
            reports[changed] = craft(changed + 1, rng, 1500.0, plain=False)
            heard = [r for r in reports if r.id != rng.randrange(4 * count)]
            wanted = conflicts(heard, now_ns, OUTLOOK)
            pairs = kept.at_risk(heard, now_ns)
            assert pairs == tuple(sorted(wanted))
            if step % 3 == 0:
                assert kept.soon_s(pairs) == tuple(wanted[pair] for pair in pairs)
            found += len(wanted)
    assert sum(spared) > 0.5 * found


def test_who_is_deep_is_nearer_than_required_both_ways() -> None:
    required = Required(100.0, 20.0)
    here = (10.0, -20.0, -300.0)
    assert is_deep(here, (10.0 + 70.6, -20.0 + 70.6, -300.0 + 19.9), required)  # 99.8 m
    assert not is_deep(here, (10.0 + 70.7, -20.0 + 70.7, -300.0), required)  # 99.98 m
    assert not is_deep(here, (10.0, -20.0, -300.0 - 19.99), required)
