"""What is wrong with a study that the types of its file cannot say, as `key: what; remedy`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import combinations
from math import prod

from fleet.faults.shorthand import shorthands
from fleet.study.design import label_of
from fleet.study.encounters.as_planned import AsPlanned
from fleet.study.study_file import Factor, Study

MOST_CELLS = 100_000

OF_RUNS = {
    "name": "each run has a name of its own",
    "seed": "each run has a seed of its own, by the study's seed",
}
"""Keys of a scenario that a run sets itself, so that to set them would change nothing."""


def problems_of(study: Study) -> Iterator[str]:
    """All that can be said before a run is made."""
    if not study.scenario and isinstance(study.encounters, AsPlanned):
        yield "scenario: missing; name one, or say which [encounters] are flown"
    name = _twice(factor.name for factor in study.factor)
    if name:
        yield f"factor: '{name}' is there twice; give each its own name"
    for factor in study.factor:
        yield from (f"factor {factor.name}: {p}" for p in _factor_problems(factor, study))
    yield from _shared_keys(study)
    yield from _idle_keys(study)
    problem = study.encounters.problem()
    if problem:
        yield f"encounters.{problem}"
    if study.stop and getattr(study.encounters, "near", None):
        yield (
            "stop: its intervals are of runs that weigh the same, not those of encounters.near; "
            "leave one of them out"
        )
    kind, points = study.design.kind, study.design.points
    if kind in ("sobol", "saltelli") and points & (points - 1):
        yield f"design.points: a {kind} design takes a power of two, as 64, not {points}"
    cells = _cell_count(study)
    if cells > MOST_CELLS:
        yield f"factor: {cells} cells, of at most {MOST_CELLS}; take fewer levels, or points"


def _factor_problems(factor: Factor, study: Study) -> Iterator[str]:
    given = [bool(factor.values), bool(factor.level), factor.low is not None]
    if sum(given) != 1 or (factor.low is None) != (factor.high is None):
        yield "give it values, [[factor.level]] tables, or low and high: one of these"
    if factor.level and (factor.key or factor.fault):
        yield "levels say themselves what they set; leave out key and fault"
    if not factor.level and bool(factor.key) == bool(factor.fault):
        yield "name what it varies: either key, as resolution.horizon_s, or fault, as loss"
    if factor.fault and factor.fault not in shorthands():
        yield f"fault: no '{factor.fault}'; there are {', '.join(shorthands())}"
    labels = [table.label for table in factor.level] or [label_of(v) for v in factor.values]
    level = _twice(labels)
    if level:
        yield f"level '{level}' is there twice; leave one out, or give each its own label"
    if factor.low is not None and factor.high is not None and factor.low >= factor.high:
        yield "low: not below high"
    grid = study.design.kind == "grid"
    if grid and factor.drawn:
        yield "low and high are for designs that draw points; give it values, or another design"
    if not grid and not factor.drawn:
        yield f"a {study.design.kind} design draws points: give it low and high"


def _shared_keys(study: Study) -> Iterator[str]:
    """Keys that two factors set, of which one would change nothing."""
    for one, other in combinations(study.factor, 2):
        for key in sorted(_keys_of(one) & _keys_of(other)):
            yield f"factor: '{one.name}' and '{other.name}' both set {key}; leave it to one of them"


def _idle_keys(study: Study) -> Iterator[str]:
    """Keys that change nothing, since runs or their encounters set them."""
    factors = [(f"factor {f.name}: ", key) for f in study.factor for key in sorted(_keys_of(f))]
    given = [("set.", key) for key in study.set]
    for where, key in [*given, *factors]:
        if key in OF_RUNS:
            yield f"{where}{key}: {OF_RUNS[key]}; leave it out"
    drawn = not isinstance(study.encounters, AsPlanned)
    scattered = not drawn and study.encounters != AsPlanned()
    for where, key in [*(given if drawn else ()), *(factors if drawn or scattered else ())]:
        if key.partition(".")[0] in ("uav", "generate"):
            yield f"{where}{key}: [encounters] says who flies; leave it out"


def _keys_of(factor: Factor) -> set[str]:
    return {factor.key} - {""} | {key for table in factor.level for key in table.set}


def _cell_count(study: Study) -> int:
    kind, points, count = study.design.kind, study.design.points, len(study.factor)
    if kind == "grid":
        return prod(len(factor.values) or len(factor.level) for factor in study.factor)
    return points * (count + 2) if kind == "saltelli" else points


def _twice(words: Iterable[str]) -> str:
    """The first that is there twice; empty if there is none."""
    return next((word for word, count in Counter(words).items() if count > 1), "")
