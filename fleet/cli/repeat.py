"""`fleet repeat`."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from fleet.agents.resolvers import load_resolver
from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.what_if import side_of
from fleet.cli.faults import Given, fault_tables, with_fault_options
from fleet.cli.reading import opened_run
from fleet.cli.result import warning_lines
from fleet.cli.screen import Screen
from fleet.cli.trust import Trust, refuse_code
from fleet.cli.whatif import what_if_tables
from fleet.config.loading import with_faults, with_settings
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.log.new_files import keep
from fleet.log.reader import read
from fleet.log.run_metadata import run_metadata_of
from fleet.model.words import BusKind
from fleet.printing import printable
from fleet.repetition.compare import Comparison, Difference, UnlikeMessages, compare_runs
from fleet.repetition.first_part import unlike_text
from fleet.repetition.logged_ticks import scenario_flown, ticks_of
from fleet.simulation.flying import check_repeatable
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet, run_metadata

MESSAGES_SHOWN = 5


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("repeat")(repeat_log)


@with_fault_options
def repeat_log(
    log: Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")],
    bus: Annotated[
        BusKind, typer.Option(help="Both give the same digest; memory needs no processes.")
    ] = BusKind.MEMORY,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="What if: change any field of the scenario flown, as in resolution.horizon_s=30 "
            "or fault=[].",
        ),
    ] = None,
    connect: Annotated[
        str,
        typer.Option(
            metavar="ENDPOINT",
            help="Others start all participants again, at the zenoh router there, as for "
            "'fleet run --external': for UAVs of other programs.",
        ),
    ] = "",
    out: Annotated[Path | None, typer.Option(help="Keep the log of the new run.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing log.")] = False,
    trust: Trust = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object, nothing else.")
    ] = False,
    *,
    faults: Given,
) -> int:
    """Fly the run of a log again and compare: the same (0), or where it differs first (1).

    With --set or faults it is a what-if of the same encounter: both are shown side by side (0).

    \b
    Examples:
      fleet repeat four_way.mcap
      fleet repeat four_way.mcap --bus zenoh
      fleet repeat with_my_uav.mcap --connect tcp/127.0.0.1:7447
      fleet repeat four_way.mcap --loss 30% --kill 1@60s
      fleet repeat four_way.mcap --set fault=[] --set resolution.horizon_s=20
    """  # noqa: D301 (the \b keeps the lines apart)
    keep(log, out)
    what_if = bool(settings) or any(faults.values())
    try:
        original = opened_run(log, lenient=True)
        if not what_if:
            check_repeatable(original)
        scenario = with_settings(scenario_flown(original), settings or (), str(log))
        tables = fault_tables(faults, scenario.surveillance.broadcast_s)
        scenario = with_faults(scenario, tables, str(log))
        own = any(s.partition("=")[0].strip() == "resolver" for s in settings or ())
        _check_resolver(scenario, log, trusted=trust or own)
        for line in warning_lines(scenario, tables, realtime=False) if what_if else ():
            print(line, file=sys.stderr)
        with _kept(out) as path:
            overrides = tuple(settings or ())
            options = _options(original, scenario, overrides, bus.value, path, force)
            if connect:
                options = replace(options, bus=BusKind.ZENOH, connect=connect, external=True)
            outcome = _fly(options)
            if outcome.status == "invalid":
                print(
                    f"fleet: new run INVALID at {outcome.sim_s:g} s: {printable(outcome.why)}",
                    file=sys.stderr,
                )
                return 1
            if what_if:
                return _show_what_if(original, RecordedRun.of_log(path), out, as_json)
            found = compare_runs(original, ticks_of(read(path)))
        return _show(original, outcome, found, out, as_json)
    except KeyboardInterrupt:
        print("fleet: interrupted", file=sys.stderr)
        return 130


@contextmanager
def _kept(out: Path | None) -> Iterator[Path]:
    """Where the log of the new run goes; unless it is to be kept, to where it vanishes."""
    if out is not None:
        yield out
        return
    with tempfile.TemporaryDirectory(prefix="fleet-repeat-") as folder:
        yield Path(folder) / "repeated.mcap"


def _check_resolver(scenario: Scenario, log: Path, *, trusted: bool) -> None:
    if not trusted:
        refuse_code(scenario, f"{log}: its run", "or another with --set resolver=geometric")
    try:
        load_resolver(scenario)
    except ValueError as error:
        raise ScenarioError(f"{log}: {error}") from error


def _options(
    original: RecordedRun,
    scenario: Scenario,
    settings: tuple[str, ...],
    bus: str,
    out: Path,
    force: bool,
) -> RunOptions:
    settings = (*original.about.overrides, *settings)
    text = original.about.scenario_toml
    return RunOptions(scenario, text, settings, bus=bus, out=out, force=force)


def _fly(options: RunOptions) -> RunOutcome:
    """Run with a progress bar on standard error, if that is a terminal; passes Ctrl-C on."""
    console = Screen(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task("repeat", total=options.scenario.ticks)
        outcome = run_fleet(options, lambda o: progress.update(task, completed=o.ticks))
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    return outcome


def _show(
    original: RecordedRun, outcome: RunOutcome, found: Comparison, out: Path | None, as_json: bool
) -> int:
    """Print what the comparison found."""
    versions = _other_versions(original, outcome.options)
    if as_json:
        told = {
            "log": str(original.path),
            "verdict": found.verdict,
            "complete": original.complete,
            "ticks": found.ticks,
            "digest": outcome.run_recorder.digest,
            "altered": asdict(found.altered) if found.altered else None,
            "differs": asdict(found.differs) if found.differs else None,
            "versions": versions,
            "external": original.about.external,
            "repeated_log": str(out) if out else "",
        }
        print(json.dumps(told))
        return 0 if found.verdict == "same" else 1
    for word, finding in (("altered", found.altered), ("different", found.differs)):
        if finding:
            print("\n".join(_lines(word, finding, original)))
    if found.verdict == "same":
        print(f"same: {found.ticks} ticks, digest {outcome.run_recorder.digest}")
    elif not found.differs:
        print("the repetition gives the digests that were recorded: the run itself is the same")
    if not original.complete:
        status = original.about.status
        why = f"its run was {printable(status)}" if status else "it is damaged or cut short there"
        print(f"compared up to {outcome.sim_s:g} s, where the log ends: {why}")
    if found.differs and original.about.external and not outcome.options.external:
        print(
            "its participants were started by others: if one was another program, the fleet's own "
            "UAV has flown in its place here; --connect ENDPOINT waits for all of them to join"
        )
    if found.differs and versions:
        changes = ", ".join(f"{k} {a}, here {b}" for k, (a, b) in versions.items())
        print(f"the log was written with other versions: {changes}")
    return 0 if found.verdict == "same" else 1


def _lines(word: str, finding: Difference, original: RecordedRun) -> list[str]:
    """A finding, a line for each message."""
    at = f"tick {finding.tick} ({finding.t_ns / 1e9:g} s)"
    lines = [f"{word}: {original.path}, {at}: {printable(finding.why)}"]
    lines += [f"  {_words(m)}" for m in finding.messages[:MESSAGES_SHOWN]]
    more = len(finding.messages) - MESSAGES_SHOWN
    return [*lines, f"  and {more} more messages"] if more > 0 else lines


def _words(message: UnlikeMessages) -> str:
    """A message and what is unlike: the value in the log, then that of the repetition."""
    fields = [unlike_text(name, a, b) for name, (a, b) in message.fields.items()]
    where = f" (byte {message.byte})" if message.byte is not None else ""
    words = f"{message.topic}  seq={message.seq}  {message.t_ns / 1e9:.3f} s  {message.what}{where}"
    return words + ("  " + "; ".join(fields) if fields else "")


def _other_versions(original: RecordedRun, options: RunOptions) -> dict[str, tuple[str, str]]:
    """What the log was written with and what is installed here, where they differ."""
    here = run_metadata_of(
        original.path or Path(), {"run": run_metadata(replace(options, scenario=original.scenario))}
    )
    log, now = (
        {"fleet": a.fleet_version, "python": a.python, **a.versions} for a in (original.about, here)
    )
    return {n: (log.get(n) or "?", v) for n, v in now.items() if log.get(n) != v}


def _show_what_if(
    original: RecordedRun, changed: RecordedRun, out: Path | None, as_json: bool
) -> int:
    """Print the logged run and the new one side by side."""
    log, new = side_of(original), side_of(changed)
    if as_json:
        kept = str(out) if out else ""
        told = {"flown": log.result, "what_if": new.result, "new_log": kept}
        print(json.dumps({"log": str(original.path), **told}))
        return 0
    Screen().print(*what_if_tables(log, new), sep="\n")
    if original.realtime:
        print("the log is of a realtime run: part of what differs is due to its clock")
    elif not original.complete:
        print(f"the log is not of a whole run: both sides end at {new.result['sim_s']:g} s")
    return 0
