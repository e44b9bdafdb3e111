"""Pictures of a run from its log: data (pure), figures, and the page that holds them."""

from fleet.log.recorder import LogError


class MissingExtraError(LogError):
    """A package of the extra `report` is not installed; the message says what to do."""
