"""What documents have from the code is as the code has it now."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.docs import PARTS, ROOT, documents, written


@pytest.mark.parametrize("path", documents(), ids=lambda p: str(p.relative_to(ROOT)))
def test_generated_parts_are_up_to_date(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text == written(text), "stale: python -m tools.docs"


def test_every_part_is_in_some_document() -> None:
    told = "".join(path.read_text(encoding="utf-8") for path in documents())
    assert [name for name in PARTS if f"<!-- generated: {name} -->" not in told] == []


def test_a_stale_part_is_found() -> None:
    part = "<!-- generated: keys of every fault -->\n{}\n<!-- end -->"
    found = written(part.format("\nstale\n"))
    assert "stale" not in found
    assert written(found) == found
