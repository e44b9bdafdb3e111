"""The columns of a study's results, as a table of docs/studies.md."""

from __future__ import annotations

from typing import get_args, get_type_hints

from msgspec import Meta

from fleet.study.run_row import RunRow


def row_columns() -> str:
    """A row for each column, as it describes itself."""
    hints = get_type_hints(RunRow, include_extras=True)
    lines = ["| column | what it is |", "|---|---|"]
    for name in RunRow.__struct_fields__:
        described = next(part for part in get_args(hints[name]) if isinstance(part, Meta))
        lines.append(f"| `{name}` | {described.description} |")
    return "\n".join(lines)
