"""Several messages judged at once: each meets the fate that it meets alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.faults.channel import Channel, Delivery, Fate, judged_together
from fleet.faults.draws import Draws, LinkMessageColumns
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.partition import Partition
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.reorder import Reorder
from fleet.faults.rules import Rule

TICK_NS = 100_000_000
numbers = st.sampled_from(("*", "uav", "coordinator", "2", "1-3,6"))
windows: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    {
        "start_s": st.sampled_from((0.0, 0.0, 2.0)),
        "end_s": st.sampled_from((None, None, 3.0)),
        "src": numbers,
        "dst": numbers,
        "classes": st.sampled_from(("*", "adsb", "cmd,ack", "ack,adsb")),
    }
)
shares = st.sampled_from((0.0, 0.2, 0.7, 1.0))


@st.composite
def rules(draw: st.DrawFn) -> Rule:
    """Any rule of a kind that is judged together."""
    common = draw(windows)
    match draw(st.integers(0, 5)):
        case 0:
            return Loss(probability=draw(shares), **common)
        case 1:
            form = draw(st.sampled_from(("constant", "uniform", "exponential", "lognormal")))
            keys: dict[str, Any] = {
                "distribution": form,
                "cap_s": draw(st.sampled_from((0.5, 3600.0))),
            }
            keys |= {"base_s": draw(st.floats(0.0, 2.0)), "jitter_s": draw(st.floats(0.0, 2.0))}
            return Latency(**keys, **common)
        case 2:
            return Burst(loss=0.4, mean_ticks=draw(st.sampled_from((1.0, 6.0))), **common)
        case 3:
            return Reorder(probability=draw(shares), delay_s=0.9, **common)
        case 4:
            return Partition(groups="1,2/3,coordinator/4-9", **common)
        case _:
            return Range(model="rayleigh", scale_m=900.0, **common)


@st.composite
def sent(draw: st.DrawFn) -> LinkMessageColumns:
    """Broadcasts of some of nine UAVs, as one of them or the coordinator hears them."""
    src = sorted(draw(st.sets(st.integers(0, 9), min_size=1)))
    many = len(src)
    seqs = st.lists(st.integers(0, 2**52), min_size=many, max_size=many)
    far = st.one_of(st.just(math.nan), st.floats(0.0, 3000.0))
    return LinkMessageColumns(
        np.array(src),
        draw(st.integers(0, 9)),
        draw(st.sampled_from(("adsb", "cmd"))),
        np.array(draw(seqs)),
        TICK_NS * draw(st.integers(0, 50)),
        np.full(many, 1600),
        np.array(draw(st.lists(far, min_size=many, max_size=many))),
    )


@given(st.lists(rules(), max_size=4), st.lists(sent(), min_size=1, max_size=5))
@settings(deadline=None, derandomize=True, max_examples=300)
def test_each_of_several_messages_meets_its_own_fate(
    plan: list[Rule], batches: list[LinkMessageColumns]
) -> None:
    together, alone = Channel(plan, 7, TICK_NS), Channel(plan, 7, TICK_NS)
    assert together.judges_together
    for batch in batches:
        fates = together.fates(batch)
        for n in range(len(batch.src)):
            arrives = (Delivery(int(fates.delay_ns[n])),) if fates.arrives[n] else ()
            assert Fate(arrives, fates.dropped_by[n]) == alone.fate(batch.one(n))


@given(sent(), st.integers(0, 3))
@settings(deadline=None, derandomize=True)
def test_several_draws_are_those_of_each(batch: LinkMessageColumns, count: int) -> None:
    draws, others = Draws(3, 1), Draws(3, 1)
    alone = [others.of_message("loss", batch.one(n), count) for n in range(len(batch.src))]
    assert draws.of_message("loss", batch, count).tolist() == alone


def test_what_copies_alters_or_queues_is_judged_one_by_one() -> None:
    for rule in (
        Duplicate(probability=0.1),
        Corrupt(probability=0.1),
        Rate(bits_per_s=9600.0),
    ):
        assert not judged_together([Loss(probability=0.1), rule])
    assert judged_together([Loss(probability=0.1), Latency(base_s=0.1)])
