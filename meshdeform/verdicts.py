"""Name what a report says that a result is worth, and read it from any report that was ever stored.

Whoever shows a report reads it here: the command line, the clients, the MCP server. The rule is in
`meshdeform.runs.worth`; the page has its own reader, `service/web/app/verdict.js`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

__all__ = ["Verdict", "read_verdict"]

_EARLIER = (
    "An earlier version made this result. It said only that the asset was not the better one, which is not to say that "
    "the result is good."
)


class Verdict(StrEnum):
    """What a result is worth, by a run's own checks."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    KEEP_SOURCE = "keep_source"


def read_verdict(report: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return a report's verdict; None if it has none, as where nothing was deformed.

    Returns dict: `value`, the value of a `Verdict`; `reasons` and `advice`, lists of sentences; and what else is
    stored. A value that this version does not know is doubtful: `keep_result`, of earlier versions, said no more.
    """
    stored = report.get("verdict")
    if not isinstance(stored, Mapping):
        return None
    reasons, advice = ([str(each) for each in stored.get(name) or ()] for name in ("reasons", "advice"))
    value = stored.get("value")
    if value not in list(Verdict):
        value, reasons = Verdict.DOUBTFUL.value, reasons or [_EARLIER]
    return {**stored, "value": value, "reasons": reasons, "advice": advice}
