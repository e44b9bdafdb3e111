"""Study files that cannot mean what they say are refused, with the key; others mean all of it."""

from __future__ import annotations

from typing import Any

import pytest

from fleet.errors import StudyError
from fleet.study.design import cells_of
from fleet.study.loading import base_scenario, load_study
from fleet.study.scenario_of_run import scenario_of_run

PAIRS: dict[str, Any] = {"name": "pairs", "encounters": {"kind": "pairs"}}
HORIZON = {"name": "horizon", "key": "resolution.horizon_s", "values": [20, 40]}
LOSS = {"name": "loss", "fault": "loss", "unit": "%"}
SCATTERED = {"kind": "as_planned", "along_m": 50.0}


def one_factor(**factor: Any) -> dict[str, Any]:
    return {"factor": [{"name": "x", **factor}]}


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (one_factor(key="seed", values=[1, 2]), "factor x: seed: each run has a seed of its own"),
        (one_factor(key="name", values=["a", "b"]), "factor x: name: each run has a name"),
        ({"set": {"seed": 3}}, "set.seed: each run has a seed of its own"),
        ({"set": {"uav.1.speed_mps": 30}}, r"set.uav.1.speed_mps: \[encounters\] says who flies"),
        (
            {"scenario": "four_way", "encounters": SCATTERED}
            | one_factor(key="uav.1.speed_mps", values=[20, 30]),
            r"factor x: uav.1.speed_mps: \[encounters\] says who flies",
        ),
        (
            {
                "factor": [
                    HORIZON,
                    {"name": "both", "level": [{"label": "a", "set": {HORIZON["key"]: 9}}]},
                ]
            },
            "'horizon' and 'both' both set resolution.horizon_s",
        ),
        ({"factor": [{**LOSS, "values": [0, 30, 0.0]}]}, "factor loss: level '0' is there twice"),
        (one_factor(level=[{"label": "a"}, {"label": "a"}]), "level 'a' is there twice"),
        (one_factor(key="resolver", values=["none", "nix"]), "run 0 of cell 1 .*'nix'"),
        (
            {
                "stop": {"half_width": 0.1},
                "encounters": {
                    "kind": "pairs",
                    "near": {"share": 0.5, "miss_m": 100, "vertical_m": 10},
                },
            },
            "stop: .*encounters.near",
        ),
        (
            {"factor": [{**LOSS, "low": 0, "high": 9}], "design": {"kind": "sobol", "points": 10}},
            "a sobol design takes a power of two, as 64, not 10",
        ),
        (
            {"factor": [{**LOSS, "name": f"l{n}", "values": [*range(50)]} for n in range(8)]},
            "39062500000000 cells, of at most 100000",
        ),
    ],
)
def test_what_would_change_nothing_or_not_be_what_it_says_is_refused(
    change: dict[str, Any], why: str
) -> None:
    with pytest.raises(StudyError, match=why):
        load_study({**PAIRS, **change})


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"name": "a b"}, "study: name: expected 1 to 64 letters"),
        ({"cells": 3}, "study: cells: unknown key; leave it out"),
        ({"encounters": {"miss_m": [0, 1]}}, "study: encounters.kind: missing; add it"),
        (
            {"encounters": {"kind": "pear"}},
            "encounters.kind: invalid value 'pear'; expected one of as_planned, pairs,",
        ),
        (
            {"design": {"kind": "pear"}},
            "design.kind: invalid enum value 'pear'; expected one of grid, latin_hypercube",
        ),
        ({"factor": [{"name": "1"}]}, r"factor\[0\].name: expected 1 to 40 letters"),
        ({"stop": {}}, "study: stop.half_width: missing; add it"),
        ({"runs": "many"}, "study: runs: expected a whole number, got text"),
    ],
)
def test_what_a_key_has_to_be_is_said_in_words(change: dict[str, Any], why: str) -> None:
    with pytest.raises(StudyError, match=why):
        load_study({**PAIRS, **change})


def test_two_files_may_come_in_any_order() -> None:
    for paths in (["head_on", "four_way"], ["four_way", "head_on"]):
        study = load_study({"name": "files", "encounters": {"kind": "files", "paths": paths}})
        (cell,) = cells_of(study)
        flown = [scenario_of_run(study, base_scenario(study), cell, n) for n in (0, 1)]
        assert [len(scenario.uav) for scenario in flown] == [
            2 if p == "head_on" else 4 for p in paths
        ]


def test_a_factor_may_be_the_duration_and_whole_numbers() -> None:
    factors = [
        {"name": "duration", "key": "duration_s", "values": [50, 70.5]},
        {"name": "candidates", "key": "resolution.turn_candidates", "values": [5, 9]},
    ]
    study = load_study({**PAIRS, "factor": factors})
    base = base_scenario(study)
    flown = [scenario_of_run(study, base, cell, 3) for cell in cells_of(study)]
    assert [(s.duration_s, s.resolution.turn_candidates) for s in flown] == [
        (50.0, 5),
        (50.0, 9),
        (70.5, 5),
        (70.5, 9),
    ]
    assert [level.number for level in cells_of(study)[3].levels] == [70.5, 9.0]


def test_who_flies_may_be_a_factor_where_the_scenario_says_it() -> None:
    table = {
        "name": "more",
        "scenario": "crossing",
        **one_factor(key="generate.count", values=[4, 8]),
    }
    assert [level.label for cell in cells_of(load_study(table)) for level in cell.levels] == [
        "4",
        "8",
    ]
