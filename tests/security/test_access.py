"""Who may do what at a router follows from the classes of messages."""

from __future__ import annotations

from fleet.model.types import COORDINATOR
from fleet.protocol.classes import MESSAGE_BY_KIND, issues_class
from fleet.security.access import Right, access_control, rights
from fleet.security.identity import OBSERVER, OPERATOR
from tests.support.samples import SAMPLES

UAVS = (1, 2, 7)
ALLOWED = rights(UAVS)


def topics(name: str, message: str, flow: str) -> set[str]:
    """On which topics a certificate allows something."""
    return {
        topic
        for right in ALLOWED[name]
        if message in right.messages and right.flow == flow
        for topic in right.topics
    }


def test_everybody_publishes_under_the_own_name_alone() -> None:
    for name, issuer in {"uav-7": "7", "coordinator": "coordinator", "sim": "sim"}.items():
        said = topics(name, "put", "ingress")
        assert said
        assert {topic.split("/")[0] for topic in said} == {issuer}
    assert not topics(OBSERVER, "put", "ingress")
    assert not topics(OPERATOR, "put", "ingress")
    assert not topics("", "put", "ingress")


def test_what_a_class_declares_of_its_issuers_is_what_they_may_publish() -> None:
    for kind in MESSAGE_BY_KIND:
        for name, number in {"uav-7": 7, "coordinator": COORDINATOR}.items():
            issuer = name.removeprefix("uav-")
            allowed = f"{issuer}/{kind}/**" in topics(name, "put", "ingress")
            assert allowed == issues_class(number, kind)
    assert "coordinator/election/**" in topics("coordinator", "put", "ingress")
    assert "7/heartbeat/**" not in topics("uav-7", "put", "ingress")


def test_samples_come_from_issuers_that_their_class_declares() -> None:
    for message in SAMPLES:
        assert issues_class(message.id, message.kind), message


def test_a_uav_hears_broadcasts_and_what_goes_to_it_and_no_true_state() -> None:
    heard = topics("uav-7", "declare_subscriber", "ingress")
    assert heard == topics("uav-7", "put", "egress")
    assert {"*/adsb/**", "*/cmd/7", "*/ack/7", "sim/clock"} <= heard
    assert not any("truth" in topic or topic.startswith("**") for topic in heard)


def test_only_operators_ask_for_changes_and_only_the_simulation_answers() -> None:
    for name in ALLOWED:
        assert ("sim/fault" in topics(name, "query", "ingress")) == (name == OPERATOR)
        assert ("sim/pace" in topics(name, "query", "ingress")) == (name == OPERATOR)
        assert ("sim/view" in topics(name, "query", "ingress")) == (name in (OPERATOR, OBSERVER))
        for topic in ("sim/fault", "sim/pace", "sim/view"):
            assert (topic in topics(name, "reply", "ingress")) == (name == "sim")


def test_who_operates_sees_whether_the_run_is_on() -> None:
    assert "sim/alive" in topics(OPERATOR, "liveliness_query", "ingress")


def test_nobody_deletes_and_all_else_is_denied() -> None:
    control = access_control(UAVS, "run")
    assert control["enabled"]
    assert control["default_permission"] == "deny"
    assert all(rule["permission"] == "allow" for rule in control["rules"])
    assert not any("delete" in rule["messages"] for rule in control["rules"])
    named = {rule["id"] for rule in control["rules"]}
    used = {rule for policy in control["policies"] for rule in policy["rules"]}
    assert named == used
    keys = {key for rule in control["rules"] for key in rule["key_exprs"]}
    assert all(key.startswith(("fleet/run/", "@/*/router/")) for key in keys)


def test_rules_grow_with_the_fleet_and_not_with_its_square() -> None:
    few, many = (len(access_control(range(1, n + 1))["rules"]) for n in (100, 200))
    assert many - few == 100 * len({*ALLOWED["uav-7"]} - {*ALLOWED["uav-1"]})
    assert Right(("declare_subscriber",), "egress", ("**",)) in ALLOWED["uav-1"]
