"""Whole jobs that deform an asset, on bytes."""

from __future__ import annotations

import json
from typing import Any

from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.optimised import TextDeformRun
from tests.fakes import FakePrior

GIVEN = ("prior", "target", "pictures", "checkpoint", "initial", "resolved")


def started(asset: bytes, prompt: str = "an egg", *, output: dict[str, Any] | None = None, **params: Any) -> Any:
    """Return the run of a job; its prior is a fake one unless another, or None, is given.

    A prompt with the default guidance does not ask what the asset is: that takes longer than a test.
    """
    given = {"prior": FakePrior(), **{name: params.pop(name) for name in GIVEN if name in params}}
    kept = {} if "guidance" in params else {"orientation": "keep"}
    document = {"prompt": prompt, "params": grouped({"preset": "preview", **kept, **params}), "output": output or {}}
    request = JobRequest.model_validate(document)
    return text_deform.start(job_input(asset=asset, filename="a.glb", request=request, **given))


def finished(run: TextDeformRun) -> tuple[bytes, dict[str, Any]]:
    """Run to the end; return the result and the report."""
    for _ in run:
        pass
    files = run.finish()
    return files["result.glb"].data, json.loads(files["report.json"].data)
