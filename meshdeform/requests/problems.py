"""Say in plain words what is wrong with a document, by pydantic's findings, and what was probably meant.

Needs only the standard library, so that commands, the API and tools can all use it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from difflib import get_close_matches
from typing import Any

__all__ = ["did_you_mean", "meant", "reason"]

_CLOSE = 0.6
_LONGEST = 64
_LIBRARYS_OWN = re.compile(r"^(?:Value error|Assertion failed), ")
_QUOTED = re.compile(r"'([^']*)'")


def did_you_mean(name: str, known: Collection[str], what: str = "member") -> str:
    """Return a sentence about an unknown name, with the known name that it resembles or else all of them.

    `what` says what the name is of.
    """
    others = f" There are: {', '.join(sorted(known)) or 'none'}."
    return f"there is no such {what}.{meant(name, known) or others}"


def meant(name: Any, known: Collection[str]) -> str:
    """Return the question whether a known name was meant, after a space; empty if none resembles what was written."""
    if not isinstance(name, str) or len(name) > _LONGEST:
        return ""
    matches = get_close_matches(name.lower(), sorted(known), 1, _CLOSE)
    return f" Did you mean {str(matches[0])!r}?" if matches else ""


def reason(finding: Mapping[str, Any]) -> str:
    """Return what a finding of pydantic says, without the words that only its users know.

    Of a choice, with the one that resembles what was written, if the finding has its `input`; that itself, which may be
    long or secret, is never in the text.
    """
    message = _LIBRARYS_OWN.sub("", str(finding["msg"]))
    if message.startswith("Extra inputs"):
        return "there is no such member"
    if finding["type"] in ("enum", "literal_error"):
        message += meant(finding.get("input"), _QUOTED.findall(message)).replace(" Did", ". Did", 1)
    return message
