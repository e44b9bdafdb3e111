"""Pages of reports, read as a browser does."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from typing import Any

VOID = frozenset({"meta", "input", "br", "link", "img"})


class Outline(HTMLParser):
    """Checks that elements are closed in order, and collects what matters."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.scripts = 0
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids += [value for name, value in attrs if name == "id" and value]
        self.references += [given[name] or "" for name in ("src", "href") if name in given]
        self.scripts += tag == "script"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.words.append(data)


def outline(page: str) -> Outline:
    """The page, parsed."""
    found = Outline()
    found.feed(page)
    found.close()
    assert found.open == []
    return found


def embedded(page: str) -> Any:
    """The data in a page."""
    found = re.search(r"id='report-data'>(.*?)</script>", page, re.DOTALL)
    assert found
    return json.loads(found[1])


def own_parts(page: str) -> str:
    """The page without Plotly's script."""
    head, _, rest = page.partition("<script>")
    return head + rest.partition("</script>")[2]
