"""Choosing topics with zenoh's key expressions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

_CHUNK = re.compile(r"(?:[^/*$?#]|\$\*)+")


def matcher(expression: str) -> Callable[[str], bool]:
    """Whether a topic matches a zenoh key expression: `*` a chunk, `**` any, `$*` within a chunk.

    Raises:
        ValueError: it is no key expression.

    """
    pattern = ""
    for chunk in expression.split("/"):
        if chunk == "**":
            pattern += "(?:/[^/]+)*"
        elif chunk == "*":
            pattern += "/[^/]+"
        elif _CHUNK.fullmatch(chunk):
            pattern += "/" + "[^/]*".join(re.escape(part) for part in chunk.split("$*"))
        else:
            raise ValueError(
                f"'{expression}' is no key expression over topics; write it as 3/truth, */adsb/** "
                "or sim/*"
            )
    compiled = re.compile(pattern)
    return lambda topic: compiled.fullmatch(f"/{topic}") is not None


def expressions(texts: Iterable[str] | None) -> list[str]:
    """Key expressions as given on a command line: each text holds one, or several with commas."""
    return [part.strip() for text in texts or () for part in text.split(",")]


def chosen(topics: Sequence[str], wanted: Sequence[str], excluded: Sequence[str] = ()) -> list[str]:
    """The topics that a wanted expression includes and no excluded one; none wanted: all.

    Raises:
        ValueError: one of the expressions is no key expression.

    """
    include, exclude = [matcher(w) for w in wanted], [matcher(e) for e in excluded]
    return [
        topic
        for topic in topics
        if (not wanted or any(matches(topic) for matches in include))
        and not any(matches(topic) for matches in exclude)
    ]
