"""A run that lacks its extra says which, before it reads anything."""

from __future__ import annotations

import importlib
import re
from types import ModuleType
from typing import Any

import pytest

from meshdeform.errors import AssetError, DependencyError
from meshdeform.requests.document import JobRequest
from meshdeform.runs import kind_of, kinds, start_run
from meshdeform.runs.base import job_input
from tests.cases import each_case

NO_FILE = b"nothing that anybody could read"


@pytest.fixture
def _without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let our modules that need torch fail to be imported, as they do where it is not installed."""
    found = importlib.import_module
    ours = re.compile(r"meshdeform\.(runs\.optimised|kinds\.\w+\.\w*run)")

    def import_module(name: str, package: str | None = None) -> ModuleType:
        if ours.fullmatch(name):
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
        return found(name, package)

    monkeypatch.setattr(importlib, "import_module", import_module)


def started(**document: Any) -> object:
    request = JobRequest.model_validate(document)
    return start_run(job_input(NO_FILE, "a.glb", request, target=NO_FILE, pictures=[NO_FILE]))


@pytest.mark.usefixtures("_without_torch")
@each_case(
    "document",
    [
        {"prompt": "a vase", "params": {"guidance": {"kind": "sds"}}},
        {"params": {"guidance": {"kind": "target"}}},
        {"params": {"guidance": {"kind": "silhouettes", "silhouettes": [{"azimuth": 0}]}}},
        *({"kind": kind.name} for kind in kinds()[1:]),
    ],
)
def test_what_optimises_names_the_extra_that_brings_torch(document: dict[str, Any]) -> None:
    with pytest.raises(DependencyError) as caught:
        started(**document)
    assert caught.value.extra == {"extra": "sds"}
    assert "[sds]" in caught.value.advice_text


@pytest.mark.usefixtures("_without_torch")
@each_case(
    "document",
    [
        {"prompt": "a vase", "params": {"guidance": {"kind": "exemplar"}}},
        {"prompt": "longer legs", "params": {"guidance": {"kind": "sds"}}},
        {"params": {"guidance": {"kind": "exemplar"}}},
    ],
)
def test_fits_and_changes_do_without(document: dict[str, Any]) -> None:
    with pytest.raises(AssetError):
        started(**document)


@each_case(
    ("prompt", "guidance", "needs"),
    [("a vase", "sds", True), ("longer legs", "sds", False), ("a vase", "exemplar", False), ("", "target", True)],
)
def test_a_request_tells_whether_it_needs_torch(prompt: str, guidance: str, needs: bool) -> None:
    from meshdeform.requests.document import resolve

    request = JobRequest.model_validate({"prompt": prompt, "params": {"guidance": {"kind": guidance}}})
    assert kind_of(request.kind).needs_torch(request, resolve(request.params)) is needs
