"""Logs as commands open them: with a line for what they leave aside."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.words import counted, shortage_text
from fleet.log.foreign import ForeignTopic
from fleet.log.unknown import UnknownClass
from fleet.printing import printable

NAMED = 3


def opened_run(log: Path, *, lenient: bool = False) -> RecordedRun:
    """The run of a log; what nobody here understands is ignored, which is said."""
    run = RecordedRun.of_log(log, lenient=lenient)
    if run.foreign:
        sys.stderr.write(f"fleet: {log}: ignored: {foreign_words(run.foreign)}\n")
    if run.unknown:
        sys.stderr.write(f"fleet: {log}: ignored: {unknown_words(run.unknown)}\n")
    if run.about.lacked_room:
        dropped = printable(shortage_text(run.about.lacked_room))
        sys.stderr.write(f"fleet: {log}: dropped in the run for lack of room: {dropped}\n")
    return run


def unknown_words(classes: Sequence[UnknownClass]) -> str:
    """As in `404 messages of class battery, not known here`."""
    messages = counted(sum(one.messages for one in classes), "message")
    names = ", ".join(printable(one.kind)[:40] for one in classes[:NAMED])
    more = ", ..." if len(classes) > NAMED else ""
    return (
        f"{messages} of {'class' if len(classes) == 1 else 'classes'} {names}{more}, not known here"
    )


def foreign_words(topics: Sequence[ForeignTopic]) -> str:
    """As in `120 messages of 1 foreign topic (7/battery)`."""
    messages = counted(sum(topic.messages for topic in topics), "message")
    names = ", ".join(printable(topic.topic)[:40] for topic in topics[:NAMED])
    more = ", ..." if len(topics) > NAMED else ""
    return f"{messages} of {counted(len(topics), 'foreign topic')} ({names}{more})"
