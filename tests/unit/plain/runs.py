"""Runs of changes from file to file."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input


def run(
    file: bytes, prompt: str, *, name: str = "asset.glb", noun: str | None = None, **output: object
) -> tuple[bytes, dict[str, Any]]:
    """The result and the report of a prompt, for what is a noun if one is given."""
    given = grouped({"source_noun": noun}) if noun else {}
    request = JobRequest.model_validate({"prompt": prompt, "params": given, "output": output})
    made = text_deform.start(job_input(file, name, request))
    assert [*made] == []
    artifacts = made.finish()
    return artifacts["result.glb"].data, json.loads(artifacts["report.json"].data)


def changed_positions(
    glb: bytes, prompt: str, noun: str | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, Any]]:
    """The positions that viewers show before and after a prompt, and the report."""
    result, report = run(glb, prompt, noun=noun)
    return load_asset(glb).surface.positions, load_asset(result).surface.positions, report
