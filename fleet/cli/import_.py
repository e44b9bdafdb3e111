"""`fleet import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fleet.analysis.words import counted
from fleet.imports.importing import import_traffic
from fleet.imports.scenario_making import ImportedTraffic
from fleet.log.new_files import keep, new_file
from fleet.printing import printable


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("import")(import_file)


def import_file(
    file: Annotated[
        Path,
        typer.Argument(help="A BlueSky scenario (.scn), DAIDALUS encounter (.daa) or CSV (.csv)."),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The scenario; default FILE's name with .toml, here."),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,ALT",
            help="Where NED begins, in degrees and m; default the middle of the traffic, at 0 m.",
        ),
    ] = None,
    zone: Annotated[
        str | None,
        typer.Option(
            metavar="RADIUS,HALF_HEIGHT",
            help="The protected zone in m; default what the program means by its own.",
        ),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="ACROSS,UP",
            help="How far, in m, a recorded place may be from the plan; default by the zone.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Take this aircraft. Can be given many times."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=0.001, max=86_400.0, help="Simulated seconds; default by the traffic."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> int:
    """Make a scenario of another program's encounter, and say what could not be taken over.

    \b
    Examples:
      fleet import super8.scn
      fleet import H1.daa --zone 609.6,68.58 -o head_on_far.toml
      fleet import flights.csv --origin 47.3977,8.5456,488
    """  # noqa: D301 (the \b keeps the lines apart)
    path = out or Path(f"{file.stem}.toml")
    keep(file, path)
    made = import_traffic(
        file,
        origin=_three(origin),
        zone=_two(zone, "--zone"),
        tolerance_m=_two(tolerance, "--tolerance"),
        only=tuple(only or ()),
        duration_s=duration,
    )
    with new_file(path, overwrite=force) as part:
        part.write_text(made.toml, encoding="utf-8")
    for line in made.lines():
        print(line)
    print(_made(made, path))
    return 0


def _made(made: ImportedTraffic, path: Path) -> str:
    """What has been made, in a line."""
    origin, zone = made.origin, made.scenario.zone
    name = printable(str(path))
    return (
        f"{name}: {counted(len(made.uavs), 'UAV')}, {made.scenario.duration_s:g} s, origin "
        f"{origin.latitude_deg:g},{origin.longitude_deg:g},{origin.altitude_m:g}, zone "
        f"{zone.radius_m:g},{zone.half_height_m:g}; fly it with 'fleet run {name}'"
    )


def _three(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    latitude, longitude, altitude = _numbers(text, 3, "--origin")
    return latitude, longitude, altitude


def _two(text: str | None, option: str) -> tuple[float, float] | None:
    if text is None:
        return None
    first, second = _numbers(text, 2, option)
    return first, second


def _numbers(text: str, count: int, option: str) -> list[float]:
    """So many numbers with commas between."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise typer.BadParameter(f"'{text}' is not {count} numbers with commas", param_hint=option)
    return numbers
