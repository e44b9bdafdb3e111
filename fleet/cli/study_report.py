"""`fleet study report`."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from fleet.cli.report_files import ReportFormat, check_free
from fleet.errors import StudyError
from fleet.extras import import_extra
from fleet.log.new_files import new_file
from fleet.study.results import open_results
from fleet.study_report.study_data import StudyData, study_data_of


def add_report(group: typer.Typer) -> None:
    """Add the command."""
    group.command("report")(study_report)


def study_report(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="The folder of a study's results.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="PAGE", help="The page; default the study's name with .html."),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write figures for a paper there; the page only if --out is given."
        ),
    ] = None,
    formats: Annotated[
        list[ReportFormat] | None,
        typer.Option("--format", help="Of figures; can be given many times. Default pdf."),
    ] = None,
    dpi: Annotated[
        int, typer.Option(min=50, max=1200, help="Resolution of PNG figures, dots an inch.")
    ] = 300,
    against: Annotated[
        int, typer.Option(min=0, metavar="CELL", help="The cell that others are compared with.")
    ] = 0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> int:
    """Draw what a study says: one HTML page that needs no network, or figures for a paper.

    \b
    Examples:
      fleet study report latency_loss.study --open
      fleet study report latency_loss.study --figures figures --format pdf --format png
    """  # noqa: D301 (the \b keeps the lines apart)
    page = out or (None if figures and not open_ else page_beside(results))
    if page is not None:
        check_free([page], force)
    data = study_data_of(open_results(results), str(results))
    if page is not None:
        _write_page(data, page, against, force)
        print(page)
    if figures is not None:
        suffixes = [f.value for f in formats or [ReportFormat.pdf]]
        _write_figures(data, figures, list(dict.fromkeys(suffixes)), dpi, force)
    if open_ and page is not None:
        webbrowser.open(page.resolve().as_uri())
    return 0


def page_beside(results: Path) -> Path:
    """Where the page of results goes: beside their folder, with its name."""
    folder = results if results.name not in ("", "..") else results.resolve()
    return folder.parent / f"{folder.name.removesuffix('.study')}.html"


def _write_page(data: StudyData, page: Path, against: int, force: bool) -> None:
    from fleet.study_report.study_page import study_page  # noqa: PLC0415 (only when it is drawn)

    text = study_page(data, against)
    with new_file(page, overwrite=force) as part:
        part.write_text(text, encoding="utf-8")


def _write_figures(
    data: StudyData, folder: Path, suffixes: list[str], dpi: int, force: bool
) -> None:
    import_extra("matplotlib", "report", "a figure")
    from fleet.study_report.paper import study_figures, write_study_figures  # noqa: PLC0415

    figures = study_figures(data)
    if not figures:
        raise StudyError(f"{data.said}: no run was flown, so that there is nothing to draw")
    files = [folder / f"{name}.{suffix}" for name in figures for suffix in suffixes]
    check_free(files, force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for suffix in suffixes:
            write_study_figures(figures, folder, suffix, dpi)
    except OSError as error:
        raise StudyError(f"cannot write figures to {folder}: {error.strerror}") from error
    for file in sorted(files):
        print(file)
