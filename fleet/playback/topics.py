"""Which topics of a log are replayed, and under which names."""

from __future__ import annotations

import re
from collections.abc import Sequence

from fleet.log.foreign import OUR_KINDS
from fleet.log.topics import matcher
from fleet.protocol.codec import kind_of
from fleet.protocol.topics import issuer_of

REST = "**"
_RESERVED = ("sim", "replay")
"""What speaks to all participants of a run, and to those who follow a replay."""
_PLAIN = re.compile(r"[^/*$?#]+(?:/[^/*$?#]+)*")


def foreign_key(topic: str) -> str | None:
    """The topic under which a foreign topic is replayed, without slashes at its ends.

    None if no key can have it, or if it would be heard as one of the run or of the replay.
    """
    name = topic.strip("/")
    ours = kind_of(name) in OUR_KINDS or issuer_of(name) in _RESERVED
    return name if _PLAIN.fullmatch(name) and not ours else None


class Remap:
    """One `old:=new`: a topic by another name, or with `/**` on both sides all below one."""

    def __init__(self, text: str) -> None:
        """Raises ValueError if the text is no remapping."""
        old, assigned, new = text.partition(":=")
        self.text = text
        self._below = old == REST or old.endswith(f"/{REST}")
        self._old, self._new = old, new
        if self._below:
            self._old, self._new = old.removesuffix(REST), new.removesuffix(REST)
        if (
            not assigned
            or self._below != (new == REST or new.endswith(f"/{REST}"))
            or not all(self._is_plain(part) for part in (self._old, self._new))
        ):
            raise ValueError(
                f"'{text}' is no remapping; write OLD:=NEW, as 1/adsb/0:=9/adsb/0 or 1/**:=9/**"
            )

    def renamed(self, topic: str) -> str | None:
        """The new name of a topic; None if this does not concern it."""
        if not self._below:
            return self._new if topic == self._old else None
        return self._new + topic.removeprefix(self._old) if topic.startswith(self._old) else None

    def _is_plain(self, part: str) -> bool:
        if self._below:
            return not part or (part.endswith("/") and bool(_PLAIN.fullmatch(part[:-1])))
        return bool(_PLAIN.fullmatch(part))


class Selection:
    """What to replay of a log: everything, unless `topics` are named; never what is `excluded`.

    The first remapping that concerns a topic renames it.
    """

    def __init__(
        self,
        topics: Sequence[str] = (),
        excluded: Sequence[str] = (),
        remaps: Sequence[str] = (),
    ) -> None:
        """Raises ValueError if one of them is malformed."""
        self._topics = {text: matcher(text) for text in topics}
        self._excluded = {text: matcher(text) for text in excluded}
        self._remaps = [Remap(text) for text in remaps]
        self._unused = {*topics, *excluded, *remaps}
        self._names: dict[str, str | None] = {}

    def name(self, topic: str) -> str | None:
        """The topic under which to replay a topic; None: not at all."""
        if topic not in self._names:
            self._names[topic] = self._found(topic)
        return self._names[topic]

    def unused(self) -> list[str]:
        """What was given and concerned no topic so far: most likely a slip."""
        return sorted(self._unused)

    def _found(self, topic: str) -> str | None:
        wanted = {text for text, matches in self._topics.items() if matches(topic)}
        unwanted = {text for text, matches in self._excluded.items() if matches(topic)}
        self._unused -= wanted | unwanted
        if unwanted or (self._topics and not wanted):
            return None
        for remap in self._remaps:
            new = remap.renamed(topic)
            if new is not None:
                self._unused.discard(remap.text)
                return new
        return topic
