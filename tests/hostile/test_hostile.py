"""A small, repeatable share of what `python -m tests.hostile` does by the million."""

from __future__ import annotations

import random

import pytest

from fleet.node.gate import Gate
from tests.hostile import corpus
from tests.hostile.target import TooSlowError, Watched, limited, watch
from tests.hostile.targets import TARGETS
from tests.hostile.unguided import fuzz

MOST_CORPUS_BYTES = 200_000
SHARE = 150


@pytest.mark.parametrize("name", TARGETS)
def test_whatever_is_put_in_nothing_comes_out_that_may_not(name: str) -> None:
    watched = Watched(TARGETS[name]())
    fuzz(watched, SHARE, seed=1)
    assert not [finding.what for finding in watched.findings.values()]
    assert watched.target.accepted > SHARE // 20


def test_what_may_not_come_out_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise KeyError

    monkeypatch.setattr(Gate, "_suffix", broken)
    watched = Watched(TARGETS["heartbeat"]())
    fuzz(watched, SHARE, seed=1)
    ((found, where),) = watched.findings
    assert (found, where.split()[1]) == ("KeyError", "admit")
    assert watched.findings[found, where].count > 1


def test_an_input_may_not_take_for_ever() -> None:
    def for_ever() -> None:
        while True:
            pass

    watch()
    with pytest.raises(TooSlowError), limited(0.05):
        for_ever()


def test_the_same_seed_makes_the_same_inputs() -> None:
    target = TARGETS["cmd"]()
    first = corpus.stored("cmd")[0]
    one, other = (target.mutate(random.Random(7), first) for _ in range(2))
    assert one == other != first


def test_the_corpus_is_small() -> None:
    sizes = [path.stat().st_size for path in corpus.FOLDER.iterdir()]
    assert 0 < sum(sizes) < MOST_CORPUS_BYTES
