"""All targets, by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fleet.protocol.classes import MESSAGES
from tests.hostile.file_targets import FILES
from tests.hostile.log_targets import LOGS
from tests.hostile.message_target import MessageTarget
from tests.hostile.reply_targets import REPLIES
from tests.hostile.target import Target

TARGETS: dict[str, Callable[[], Target]] = {
    **{cls.kind: partial(MessageTarget, cls.kind) for cls in MESSAGES},
    **REPLIES,
    **FILES,
    **LOGS,
}
