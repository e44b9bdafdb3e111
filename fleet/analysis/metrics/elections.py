"""Elections: who elected whom, and for how long somebody was without a computing UAV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.definition import Compared, MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.metrics.leadership import Leadership, RiskTimes
from fleet.model.types import COORDINATOR
from fleet.model.units import to_s
from fleet.protocol.messages import Election


@dataclass(frozen=True)
class TermOnRecord:
    """One term: what its metrics are computed from. `change` is that of a computing UAV."""

    data: RunArrays
    announced: Sequence[Election]
    change: bool

    @property
    def first(self) -> Election:
        """Its first announcement."""
        return self.announced[0]


term_metric = MetricOf[TermOnRecord]()


@metric_row
class TermRow(MetricRow[TermOnRecord]):
    """One term: who elected whom."""

    term: int = term_metric(
        "-",
        "the term",
        lambda term: term.first.term,
        source="docs/protocol, Election",
    )
    elector: int = term_metric(
        "-",
        "who elected; 0 is the coordinator",
        lambda term: term.first.id,
        source="docs/protocol, Election",
    )
    computing: int = term_metric(
        "-",
        "the computing UAV",
        lambda term: term.first.computing,
        source="paper, lowest number",
    )
    members: tuple[int, ...] = term_metric(
        "-",
        "the group",
        lambda term: term.first.members,
        source="docs/protocol, Election",
    )
    announced_s: float = term_metric(
        "s",
        "when it was first announced",
        lambda term: to_s(term.first.t_ns),
    )
    announcements: int = term_metric(
        "1",
        "how often it was announced",
        lambda term: len(term.announced),
    )
    change: bool = term_metric(
        "-",
        "whether a member was named with another computing UAV in the last term before that "
        "named it",
        lambda term: term.change,
    )


@dataclass(frozen=True)
class ElectionsOnRecord:
    """All elections of a run: what their metrics are computed from."""

    data: RunArrays
    risk: RiskTimes
    rows: tuple[TermRow, ...]


def _terms_text(row: ElectionMetrics) -> str:
    return f"{row.terms}, {row.by_uavs} by UAVs, {row.changes} with another computing UAV"


def _gaps_text(row: ElectionMetrics) -> str:
    without = f"{row.without_computing_s:g} s of {row.at_risk_s:g} s at risk"
    return f"{without}, longest {row.longest_without_s:g} s"


elections_metric = MetricOf[ElectionsOnRecord]()


@metric_row
class ElectionMetrics(MetricRow[ElectionsOnRecord]):
    """All elections of a run, and the time for which they left somebody without a computing UAV."""

    terms: int = elections_metric(
        "1",
        "different terms (and electors)",
        lambda run: len(run.rows),
        source="docs/protocol, Elections",
        shown=Shown("elections", _terms_text),
        compared=Compared("elections"),
    )
    by_uavs: int = elections_metric(
        "1",
        "those in which a UAV elected itself",
        lambda run: sum(row.elector != COORDINATOR for row in run.rows),
        source="docs/protocol, Elections",
    )
    changes: int = elections_metric(
        "1",
        "those with a change of the computing UAV",
        lambda run: sum(row.change for row in run.rows),
        compared=Compared("election_changes"),
    )
    announcements: int = elections_metric(
        "1",
        "`election` messages, repetitions included",
        lambda run: len(run.data.elections),
        source="docs/protocol, Election",
    )
    at_risk_s: float = elections_metric(
        "s",
        "for how long some pair was at risk",
        lambda run: run.risk.at_risk_s,
        source="eq. 9",
        compared=Compared(),
    )
    without_computing_s: float = elections_metric(
        "s",
        "for how long of that some pair at risk had no computing UAV",
        lambda run: run.risk.without_computing_s,
        shown=Shown("without computing UAV", _gaps_text),
        compared=Compared(),
    )
    longest_without_s: float = elections_metric(
        "s",
        "the longest such time without a break",
        lambda run: run.risk.longest_without_s,
    )
    rows: tuple[TermRow, ...] = elections_metric(
        "-",
        "each term: [TermRow](#termrow)",
        lambda run: run.rows,
        source="-",
    )


def measure_elections(data: RunArrays, leadership: Leadership) -> ElectionMetrics:
    """All terms, and the time without a computing UAV."""
    return ElectionMetrics.of(ElectionsOnRecord(data, leadership.of_any(), tuple(_terms(data))))


def _terms(data: RunArrays) -> Iterator[TermRow]:
    """One row a term, in order of announcement; a change gives a member another computing UAV."""
    repeated: dict[tuple[int, int], list[Election]] = {}
    for election in sorted(data.elections, key=lambda e: e.t_ns):
        repeated.setdefault((election.term, election.id), []).append(election)
    last: dict[int, int] = {}
    for announced in repeated.values():
        first = announced[0]
        before = {last[m] for m in first.members if m in last}
        last.update(dict.fromkeys(first.members, first.computing))
        yield TermRow.of(TermOnRecord(data, announced, bool(before - {first.computing})))
