"""Verdicts and what proves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from fleet.analysis.words import plain_text
from fleet.model.units import to_s
from fleet.protocol.messages import Message
from fleet.protocol.topics import topic_of


class Verdict(StrEnum):
    """Of one invariant, or of a whole run."""

    VALID = "valid"
    INVALID = "invalid"
    UNKNOWN = "unknown"


def worst(verdicts: Sequence[Verdict]) -> Verdict:
    """Invalid if any is, else unknown if any is."""
    for verdict in (Verdict.INVALID, Verdict.UNKNOWN):
        if verdict in verdicts:
            return verdict
    return Verdict.VALID


@dataclass(frozen=True)
class Witness:
    """One message that is part of a proof: when it was sent, its topic, the fields that matter."""

    t_ns: int
    topic: str
    fields: dict[str, Any] = field(default_factory=dict)

    def line(self) -> str:
        """The witness in one line; times are shown in seconds."""
        shown = " ".join(_shown(name, value) for name, value in self.fields.items())
        return f"{to_s(self.t_ns):.3f} s  {self.topic}  {shown}".rstrip()


def witness(message: Message, *names: str, **more: Any) -> Witness:
    """A message as a witness, with its fields of these names and what else there is to say."""
    picked = {name: getattr(message, name) for name in names}
    return Witness(message.t_ns, topic_of(message), picked | more)


def _shown(name: str, value: Any) -> str:
    if name.endswith("_ns") and isinstance(value, int):
        return f"{name.removesuffix('_ns')}_s={to_s(value):.3f}"
    several = value if isinstance(value, list | tuple) else (value,)
    return (
        f"{name}={','.join(f'{v:.6g}' if isinstance(v, float) else plain_text(v) for v in several)}"
    )


@dataclass(frozen=True)
class Violation:
    """One breach of an invariant: what is wrong, and the few messages that prove it."""

    what: str
    witnesses: tuple[Witness, ...]


@dataclass
class Examination:
    """What an invariant came to: how much it looked at, and what it found wrong.

    `unknown` says why nothing can be said, where that is so for another reason than that nothing
    of the kind happened.
    """

    examined: int = 0
    violations: list[Violation] = field(default_factory=list)
    unknown: str = ""

    def blame(self, what: str, *witnesses: Witness) -> None:
        """Note a violation."""
        self.violations.append(Violation(what, witnesses))


@dataclass(frozen=True)
class InvariantResult:
    """The verdict on one invariant; `witnesses` prove its first violation, of which `why` tells."""

    name: str
    verdict: Verdict
    examined: int
    of: str
    why: str = ""
    violations: int = 0
    witnesses: tuple[Witness, ...] = ()


@dataclass(frozen=True)
class Verdicts:
    """The verdicts on all invariants, and on the run as a whole.

    `warning` says what makes its times doubtful; empty if nothing does.
    """

    overall: Verdict
    why: str
    findings: tuple[InvariantResult, ...]
    warning: str = ""

    def __repr__(self) -> str:
        """The verdict on the run, and what is broken."""
        broken = f"; broken: {', '.join(self.broken)}" if self.broken else ""
        return f"<{self.overall}: {self.why or f'{len(self.findings)} invariants'}{broken}>"

    def of(self, name: str) -> InvariantResult:
        """The finding of this name; raises KeyError."""
        for finding in self.findings:
            if finding.name == name:
                return finding
        raise KeyError(name)

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of the invariants that are violated."""
        return tuple(f.name for f in self.findings if f.verdict is Verdict.INVALID)
