"""Code that is named in data, as the resolver in a log, is run only if the user says so."""

from __future__ import annotations

from typing import Annotated

import typer

from fleet.agents.resolvers import code_behind
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError

Trust = Annotated[
    bool,
    typer.Option("--trust", help="Import and run the resolver that is named, if not built in."),
]


def refuse_code(scenario: Scenario, whose: str, instead: str = "") -> None:
    """Refuse a resolver that is not built in, before anything of it is imported.

    Raises:
        ScenarioError: it is not; the message says what would be imported, and from where.

    """
    code = code_behind(scenario.resolver)
    if code:
        remedy = ", ".join(filter(None, ["give --trust to run it", instead]))
        raise ScenarioError(
            f"{whose} names a resolver that would be imported, '{scenario.resolver}' ({code}): "
            f"{remedy}"
        )
