"""`fleet check`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from fleet.analysis.invariants import Verdict, Verdicts, check, worst
from fleet.analysis.invariants.verdict import InvariantResult
from fleet.cli.reading import opened_run
from fleet.cli.screen import Screen
from fleet.printing import printable

EXIT = {Verdict.VALID: 0, Verdict.INVALID: 1, Verdict.UNKNOWN: 2}
STYLES = {Verdict.VALID: "green", Verdict.INVALID: "bold red", Verdict.UNKNOWN: "yellow"}


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("check")(check_logs)


def check_logs(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="MCAP logs written by 'fleet run'.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> int:
    """Check the protocol's invariants from logs alone: valid (0), invalid (1) or unknown (2).

    Unknown is what a log cannot tell: it is cut short, or nothing of that kind happened.

    Example: fleet check four_way.mcap
    """
    console, found = Screen(highlight=False), list[tuple[Path, Verdicts]]()
    for log in logs:
        verdicts = check(opened_run(log))
        found.append((log, verdicts))
        if not as_json:
            _show(console, log, verdicts)
    overall = worst([v.overall for _, v in found])
    if as_json:
        each = [_as_dict(log, verdicts) for log, verdicts in found]
        print(json.dumps({"verdict": overall, "logs": each}))
    elif len(found) > 1:
        console.print(f"all {len(found)} logs: {_styled(overall)}")
    return EXIT[overall]


def _show(console: Screen, log: Path, verdicts: Verdicts) -> None:
    table = Table()
    for column in ("invariant", "verdict", "examined"):
        table.add_column(column)
    for finding in verdicts.findings:
        table.add_row(finding.name, _styled(finding.verdict), escape(_examined(finding)))
    console.print(f"[italic]{escape(str(log))}[/]", soft_wrap=True)
    console.print(table)
    for finding in verdicts.findings:
        if finding.verdict is Verdict.INVALID:
            console.print(f"[bold]{finding.name}[/]: {escape(finding.why)}")
            for one in finding.witnesses:
                console.print(f"  {escape(one.line())}", soft_wrap=True)
    if verdicts.warning:
        print(f"fleet: warning: {log}: {printable(verdicts.warning)}", file=sys.stderr)
    why = f": {verdicts.why}" if verdicts.why else ""
    console.print(f"{escape(str(log))}: {_styled(verdicts.overall)}{why}", soft_wrap=True)


def _examined(finding: InvariantResult) -> str:
    """How much was examined, and what is to be said of it beside the verdict."""
    examined, why = f"{finding.examined} {finding.of}", finding.why
    if finding.verdict is Verdict.INVALID:
        why = f"violated {'once' if finding.violations == 1 else f'{finding.violations} times'}"
    return examined if why in ("", f"no {finding.of}") else f"{examined}: {why}"


def _styled(verdict: Verdict) -> str:
    return f"[{STYLES[verdict]}]{verdict}[/]"


def _as_dict(log: Path, verdicts: Verdicts) -> dict[str, Any]:
    return {
        "log": str(log),
        "verdict": verdicts.overall,
        "why": verdicts.why,
        "warning": verdicts.warning,
        "invariants": [asdict(finding) for finding in verdicts.findings],
    }
