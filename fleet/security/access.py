"""Who may do what at a router, by the name in the certificate: all else is denied.

Derived from the classes of messages: who issues them and who hears them. The rules are zenoh's
(`access_control`), as plain data. "ingress" is what comes from a process, "egress" what goes to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from fleet.model.types import COORDINATOR
from fleet.protocol.classes import (
    ADDRESSED,
    DELIVERY_ORDER,
    MESSAGE_BY_KIND,
    hears_class,
    issues_class,
)
from fleet.protocol.topics import (
    ABORT,
    ANY,
    CLOCK,
    EVERYTHING,
    FAULT,
    PACE,
    PLAN,
    SIMULATION,
    VIEW,
    alive,
    issuer_name,
    key,
    progress_of,
    step_of,
)
from fleet.security.identity import OBSERVER, OPERATOR, ROUTER, certificate_name

EVERY_MESSAGE = [
    "put",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
]
"""Routers that are linked have judged what their own clients say."""
ROUTERS_THEMSELVES = "@/*/router/**"
"""Keys at which routers tell what is declared there."""


@dataclass(frozen=True)
class Right:
    """Some kinds of zenoh's messages, in one direction, on some topics."""

    messages: tuple[str, ...]
    flow: str
    topics: tuple[str, ...]


def _says(*topics: str) -> list[Right]:
    return [
        Right(("put",), "ingress", topics),
        # it is told who listens, or its router session would send nothing
        Right(("declare_subscriber",), "egress", (EVERYTHING,)),
    ]


def _hears(*topics: str) -> list[Right]:
    return [Right(("declare_subscriber",), "ingress", topics), Right(("put",), "egress", topics)]


def _answers(*topics: str) -> list[Right]:
    return [
        Right(("declare_queryable", "reply"), "ingress", topics),
        Right(("query",), "egress", topics),
    ]


def _asks(*topics: str) -> list[Right]:
    return [
        Right(("query",), "ingress", topics),
        Right(("declare_queryable", "reply"), "egress", topics),
    ]


def _is_seen(name: str) -> list[Right]:
    return [Right(("liveliness_token",), "ingress", (alive(name),))]


def _sees(*topics: str) -> list[Right]:
    return [
        Right(("declare_liveliness_subscriber", "liveliness_query"), "ingress", topics),
        Right(("liveliness_token",), "egress", topics),
    ]


def participant_rights(number: int) -> list[Right]:
    """Its own classes under its own name, what it hears, and who is there.

    A relay and the program that flies for it show the same certificate: one asks, one answers.
    """
    name = issuer_name(number)
    issued = [kind for kind in MESSAGE_BY_KIND if issues_class(number, kind)]
    heard = [kind for kind in DELIVERY_ORDER if hears_class(number, kind)]
    own = [f"*/{kind}/{name}" if kind in ADDRESSED else f"*/{kind}/**" for kind in heard]
    flying = [] if number == COORDINATOR else [step_of(name)]
    return [
        *_says(*(f"{name}/{kind}/**" for kind in issued)),
        *_hears(CLOCK, ABORT, *own),
        *_answers(progress_of(name), *flying),
        *(_asks(*flying) if flying else []),
        *_is_seen(name),
        *_sees(alive(name), alive(SIMULATION)),
    ]


def simulation_rights() -> list[Right]:
    """The clock, and to hear all that is said; it answers for plan and faults."""
    return [
        *_says(f"{SIMULATION}/**"),
        *_hears(EVERYTHING),
        *_answers(PLAN, FAULT, VIEW, PACE),
        *_asks(progress_of(ANY)),
        *_is_seen(SIMULATION),
        *_sees(alive(ANY)),
    ]


def rights(uavs: Iterable[int]) -> dict[str, list[Right]]:
    """What each may do, by the name in its certificate; an empty one: whoever has any."""
    return {
        "": _asks(PLAN),
        OBSERVER: [*_hears(EVERYTHING), *_sees(alive(ANY)), *_asks(VIEW)],
        OPERATOR: [*_asks(FAULT, VIEW, PACE), *_sees(alive(SIMULATION))],
        SIMULATION: simulation_rights(),
        **{
            certificate_name(issuer_name(number)): participant_rights(number)
            for number in (COORDINATOR, *uavs)
        },
    }


def access_control(uavs: Sequence[int], run: str = ANY) -> dict[str, Any]:
    """The rules of a router for these UAVs, in one run or in all; the same rule is there once."""
    rules: dict[Right, str] = {}
    subjects, policies = [], []
    for name, allowed in rights(uavs).items():
        subjects.append({"id": name or "all", **({"cert_common_names": [name]} if name else {})})
        used = [rules.setdefault(right, f"rule-{len(rules)}") for right in dict.fromkeys(allowed)]
        policies.append({"rules": used, "subjects": [name or "all"]})
    told = [_rule(rule_id, right, run) for right, rule_id in rules.items()]
    admin = {
        "id": "routers",
        "permission": "allow",
        "messages": ["query", "reply"],
        "flows": ["ingress", "egress"],
        "key_exprs": [ROUTERS_THEMSELVES],
    }
    linked = {
        "id": "links",
        "permission": "allow",
        "messages": EVERY_MESSAGE,
        "flows": ["ingress", "egress"],
        "key_exprs": [key(run, EVERYTHING), ROUTERS_THEMSELVES],
    }
    subjects.append({"id": ROUTER, "cert_common_names": [ROUTER]})
    policies.append({"rules": ["routers"], "subjects": [SIMULATION]})
    policies.append({"rules": ["links"], "subjects": [ROUTER]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*told, admin, linked],
        "subjects": subjects,
        "policies": policies,
    }


def _rule(rule_id: str, right: Right, run: str) -> dict[str, Any]:
    return {
        "id": rule_id,
        "permission": "allow",
        "messages": list(right.messages),
        "flows": [right.flow],
        "key_exprs": [key(run, topic) for topic in right.topics],
    }
