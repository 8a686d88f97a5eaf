"""What a check says of a fit before there is one, once its asset was read, and what a report says of it afterwards."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets import load_asset
from meshdeform.exemplar.outlook import FitOutlook
from meshdeform.plain.body import loose_body
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs import outlook, reading
from meshdeform.runs.base import JobFile, sha256_hex
from meshdeform.runs.kept_readings import FolderReadings
from meshdeform.runs.reading import ReadingSource, corrected
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.runs.worth import as_foreseen
from meshdeform.settings import Settings
from meshdeform.support.recent import Recent
from tests.cases import each_case
from tests.unit.plain.shapes import chair, plain_glb

CHAIR = plain_glb(chair())


def request(prompt: str, *, kind: str = "exemplar", **more: Any) -> JobRequest:
    guidance = {"kind": kind, **more}
    if kind in ("exemplar", "sds"):
        guidance |= {"source_noun": "chair", "orientation": 0.0}
    return JobRequest.model_validate({"prompt": prompt, "params": {"guidance": guidance}})


def foreseen(asked: JobRequest, folder: Path) -> Any:
    path = folder / "chair.glb"
    path.write_bytes(CHAIR)
    readings = FolderReadings(folder / "cache")
    return TEXT_DEFORM.outlook(asked, resolve(asked.params), Settings(), JobFile(None, path, "chair.glb", readings))


def read(asked: JobRequest, folder: Path) -> None:
    """Keep the reading of the chair."""
    asset, params = load_asset(CHAIR, "chair.glb"), resolve(asked.params)
    source = ReadingSource(sha256_hex(CHAIR), "chair.glb", kept=FolderReadings(folder / "cache"))
    assert corrected(loose_body(asset), asset, params, source).reader.reading is not None


def test_it_is_known_once_the_asset_was_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        reading, "_last", Recent()
    )  # what the process remembers of other tests is in no folder of this one
    near, far = request("a tall chair"), request("a castle")
    assert foreseen(far, tmp_path) is None
    read(far, tmp_path)
    assert foreseen(near, tmp_path)["doubtful"] is False
    found = foreseen(far, tmp_path)
    assert found["doubtful"] is True
    assert "castle" in found["reasons"][0]
    assert found["suggestions"]


@each_case(
    "asked",
    [
        request("a castle", kind="sds"),
        request("", kind="target"),
        request("longer legs"),
        request("a castle").model_copy(update={"output": request("").output.model_copy(update={"subdivide": True})}),
    ],
)
def test_nobody_is_asked_of_what_is_no_fit_to_a_word(
    asked: JobRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outlook, "is_read", lambda *_: pytest.fail("asked"))
    assert foreseen(asked, tmp_path) is None


def test_a_doubtful_result_says_what_was_to_be_expected() -> None:
    verdict = {"value": "doubtful", "reasons": ["It is torn."], "advice": ["Less.", "Other.", "More."], "structure": {}}
    far = FitOutlook(True, 0.2, ("A castle has towers.",), ("a tall house", "a church"))
    said = as_foreseen(verdict, far)
    assert said["reasons"] == ["It is torn.", "A castle has towers."]
    assert said["advice"] == ["Ask for what it can become: “a tall house” or “a church”.", "Less.", "Other."]
    for near in (None, FitOutlook(False, 0.1)):
        assert as_foreseen(verdict, near) == verdict
