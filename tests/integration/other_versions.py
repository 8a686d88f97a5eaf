"""Jobs that another version of Meshdeform accepted."""

from __future__ import annotations

from typing import Any

from meshdeform.record.models import Job
from meshdeform.record.repository import JobRecord
from tests.integration.record_calls import posted, set_to

__all__ = ["LATER", "accepted_elsewhere"]

LATER: dict[str, dict[str, Any]] = {
    "a kind without files": {"kind": "image_deform", "params": {"pictures": 3}},
    "a member": {"prompt": "a later vase", "params": {"seed": 3}, "wobble": {"depth": 2}},
    "a parameter": {"prompt": "a later vase", "params": {"wobble": 0.5}},
    "a member of a member": {
        "prompt": "a later vase",
        "params": {"control": {"regions": [{"node": "Lid", "wobble": 1}]}},
    },
    "a value": {"prompt": "a later vase", "params": {"preset": "ultra"}},
    "a way to write prompts": {"params": {"guidance": {"prompts": [{"text": "a pear"}, "a vase"]}}},
    "another shape": {"prompt": "a later vase", "params": ["preview"], "output": 3, "metadata": {"shot": 7}},
}
"""Requests that this version cannot read, by what is new about them."""


def accepted_elsewhere(record: JobRecord, document: dict[str, Any], owner_id: str = "", **columns: object) -> Job:
    """A job with this stored request; queued, unless `columns` of its row say otherwise."""
    kind = document.get("kind", "text_deform")
    files = {"files": {}} if kind == "image_deform" else {}
    return set_to(record, posted(record, owner_id), request=document, kind=kind, **files, **columns)
