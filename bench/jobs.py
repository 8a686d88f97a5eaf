"""Run jobs in this process, as a worker does: what several benchmarks share."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from meshdeform.assets import Limits
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.requests.choices import BUILTIN_MODEL
from meshdeform.requests.default_kind import with_kind
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput

__all__ = ["EXAMPLES", "ROOT", "artifacts", "deformed", "prior", "start"]

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"


@functools.cache
def prior(_: str = "builtin") -> Prior:
    """Return the builtin prior on the CPU."""
    return load_prior("builtin", device="cpu")


def start(document: Mapping[str, Any], files: Mapping[str, tuple[bytes, str]], limits: Limits | None = None) -> Any:
    """Start the run of a request, which names its kind or has the default's; each file is its content and its name."""
    given = {part: InputFile(data, name) for part, (data, name) in files.items()}
    request = with_kind(JobRequest.model_validate(document), BUILTIN_MODEL, given)
    return start_run(RunInput(request, given, load_prior=prior, limits=limits))


def artifacts(run: Any) -> dict[str, bytes]:
    """Take the steps of a run, and return what it makes by name."""
    for _ in run:
        pass
    return {name: each.data for name, each in run.finish().items()}


def deformed(asset: bytes, filename: str, prompt: str, **params: Any) -> dict[str, bytes]:
    """Deform an asset by a prompt, with parameters by their names alone, and return the artifacts."""
    return artifacts(start({"prompt": prompt, "params": grouped(params)}, {"asset": (asset, filename)}))
