"""Choosing topics with zenoh's key expressions."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Sequence
from functools import partial
from operator import eq

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


def _test(text: str, topics: Container[str]) -> Callable[[str], bool]:
    """Whether a topic is the one of that name, if there is one, or matches the key expression."""
    return partial(eq, text) if text in topics else matcher(text)


def chosen(topics: Sequence[str], wanted: Sequence[str], excluded: Sequence[str] = ()) -> list[str]:
    """The topics that a wanted expression includes and no excluded one; none wanted: all.

    Raises:
        ValueError: one of the expressions is neither a key expression nor one of the topics.

    """
    named = frozenset(topics)
    include, exclude = ([_test(text, named) for text in texts] for texts in (wanted, excluded))
    return [
        topic
        for topic in topics
        if (not wanted or any(matches(topic) for matches in include))
        and not any(matches(topic) for matches in exclude)
    ]
