"""Writes the parts of the documents that are made from the code: `python -m tools.docs`.

Such a part stands between `<!-- generated: NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from tools import fault_docs, metric_docs, rule_docs, state_docs, study_docs

ROOT = Path(__file__).parent.parent

PARTS: dict[str, Callable[[], str]] = {
    "keys of every fault": fault_docs.shared_keys,
    "faults of links": fault_docs.faults_of_links,
    "faults of participants": fault_docs.faults_of_participants,
    "fault shorthands": fault_docs.shorthand_rows,
    "expected delivery": fault_docs.expected_delivery,
    "states of a mandate": state_docs.mandate_states,
    "states of a command": state_docs.command_states,
    "rules of the conformance test": rule_docs.rules_of_the_conformance_test,
    "columns of a study": study_docs.row_columns,
    **metric_docs.parts(),
}
"""The text of each part, by its name."""

_PART = re.compile(r"(<!-- generated: ([^>]+) -->\n).*?(\n<!-- end -->)", re.DOTALL)


def documents() -> list[Path]:
    """All documents that can have such parts."""
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def written(text: str) -> str:
    """A document with its parts as the code has them; raises KeyError for an unknown part."""
    return _PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]()}\n{found[3]}", text)


def main() -> None:
    """Rewrite what is stale, and name it."""
    for path in documents():
        text = path.read_text(encoding="utf-8")
        if written(text) != text:
            path.write_text(written(text), encoding="utf-8")
            print(f"{path.relative_to(ROOT)}: written")


if __name__ == "__main__":
    main()
