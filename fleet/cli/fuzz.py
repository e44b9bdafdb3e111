"""`fleet fuzz`: random encounters under random faults, checked by the invariants."""

from __future__ import annotations

import json
import os
import sys
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Annotated, Any

import tomli_w
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from fleet.analysis.words import counted
from fleet.cli.screen import Screen
from fleet.errors import LogError, ScenarioError
from fleet.fuzz.campaign import CampaignTally, campaign
from fleet.fuzz.cases import case_of
from fleet.fuzz.shrink import shrink
from fleet.fuzz.trial import Trial, fly_case


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(fuzz)


def fuzz(
    runs: Annotated[int, typer.Option(min=1, help="How many cases to fly.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first case.")] = 0,
    jobs: Annotated[
        int, typer.Option(min=0, help="Processes to fly them in; 0: one for each processor.")
    ] = 0,
    out: Annotated[
        Path, typer.Option(help="Folder for the shrunk scenarios of failing cases.")
    ] = Path(),
    shrinking: Annotated[
        bool, typer.Option("--shrink/--no-shrink", help="Shrink each failing case.")
    ] = True,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object.")
    ] = False,
) -> int:
    """Fly random encounters under random faults in memory, and check each by the invariants.

    Exit code 0: no case failed; 1: some did, each is named with the command that repeats it;
    130: interrupted, after the result so far.

    \b
    Examples:
      fleet fuzz --runs 1000 --seed 1
      fleet fuzz --runs 1 --seed 1234        (repeats one case)
    """  # noqa: D301 (the \b keeps the lines apart)
    tally = CampaignTally()
    console = Screen(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    stopped = False
    try:
        with Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        ) as progress:
            task = progress.add_task("fuzz", total=runs)
            for trial in campaign(seed, runs, jobs or os.cpu_count() or 1):
                tally.add(trial)
                if trial.failures:
                    progress.console.print(_failure_line(trial), highlight=False)
                progress.update(task, advance=1)
    except BrokenProcessPool:
        print("fleet: a worker process was killed; the campaign is not complete", file=sys.stderr)
        return 1
    except KeyboardInterrupt:  # what was found in hours is not to be lost
        stopped = True
    shrunk = {t.seed: _shrunk(t, out) for t in tally.failed} if shrinking and not stopped else {}
    if as_json:
        print(json.dumps(_json(tally, shrunk)))
    else:
        Screen().print(_table(tally))
    for trial in tally.failed:
        print(f"repeat: fleet fuzz --runs 1 --seed {trial.seed}", file=sys.stderr)
        if trial.seed in shrunk:
            path = shrunk[trial.seed]
            print(
                f"shrunk: fleet run {path} --bus memory --out {path.stem}.mcap --force; "
                f"fleet check {path.stem}.mcap",
                file=sys.stderr,
            )
    if stopped:
        print(
            f"fleet: interrupted; go on with --seed {seed + tally.runs} --runs {runs - tally.runs}",
            file=sys.stderr,
        )
        return 130
    return 1 if tally.failed else 0


def _failure_line(trial: Trial) -> str:
    why = f" ({trial.crash})" if trial.crash else ""
    return f"seed {trial.seed}: {', '.join(trial.failures)}{why}"


def _shrunk(trial: Trial, folder: Path) -> Path:
    """The smallest case that fails in the same way, written to a file."""
    wanted = trial.failures

    def fails(table: dict[str, Any]) -> bool:
        try:
            return bool(set(wanted) & set(fly_case(table).failures))
        except ScenarioError:
            return False

    table = shrink(case_of(trial.seed), fails)
    path = folder / f"fuzz-{trial.seed}.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}; choose another --out") from error
    return path


def _json(tally: CampaignTally, shrunk: dict[int, Path]) -> dict[str, Any]:
    names = sorted({name for name, _ in tally.verdicts})
    verdicts = ("valid", "invalid", "unknown")
    return {
        "runs": tally.runs,
        "failed": [
            {
                "seed": t.seed,
                "failures": list(t.failures),
                "why": t.crash,
                "shrunk": str(shrunk.get(t.seed, "")),
            }
            for t in tally.failed
        ],
        "lost_separation": tally.lost_separation,
        "due": tally.due,
        "not_arrived": tally.not_arrived,
        "invariants": {n: {v: tally.verdicts[n, v] for v in verdicts} for n in names},
    }


def _table(tally: CampaignTally) -> Table:
    table = Table(title=f"{tally.runs} cases, {len(tally.failed)} failed", title_justify="left")
    table.add_column("invariant")
    for verdict in ("valid", "invalid", "unknown"):
        table.add_column(verdict, justify="right")
    for name in sorted({name for name, _ in tally.verdicts}):
        row = [str(tally.verdicts[name, v]) for v in ("valid", "invalid", "unknown")]
        table.add_row(name, *row)
    cases = counted(tally.lost_separation, "case")
    table.caption = (
        f"separation was lost in {cases}, {tally.not_arrived} of {counted(tally.due, 'UAV')} due "
        "did not arrive (neither is a violation)"
    )
    return table
