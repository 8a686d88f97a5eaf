"""A fitted family gives the meshes of a word: members and drawn shapes, turned alike, with their parts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench.parametric_families import family, labels_document
from meshdeform.errors import AssetError
from meshdeform.kinds.families.family_file import read_family
from meshdeform.kinds.families.word_meshes import family_meshes
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.support.files import zipped
from meshdeform.words import WordOffer

MEMBERS = 10


@pytest.fixture(scope="module")
def chairs() -> tuple[bytes, bytes]:
    """A family of labelled chairs, and its collection."""
    members = family("chairs", MEMBERS)
    data = zipped(
        {each.name: each.glb() for each in members}
        | {"labels.json": json.dumps(labels_document("chairs", members, MEMBERS)).encode()}
    )
    params = {"points": 40, "samples": 80, "iterations": 3, "epochs": 20, "read": False}
    request = JobRequest.model_validate({"kind": "family_fit", "params": params})
    run = start_run(RunInput(request, {"collection": InputFile(data, "chairs.zip")}))
    for _ in run:
        pass
    return run.finish()["family.safetensors"].data, data


def test_members_and_drawn_shapes_are_shapes_of_the_word(
    chairs: tuple[bytes, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    making = pytest.importorskip("meshdeform.kinds.words.making")
    monkeypatch.setattr(making, "read_source", lambda *_, **__: None)  # which takes time
    files = family_meshes(*chairs)
    fitted = read_family(chairs[0])
    assert list(files)[MEMBERS:] == [f"drawn-{number}.glb" for number in range(1, 9)]
    word = making.make_word(WordOffer("bar-stool", front_deg=0.0), files)
    assert len(word.shapes) == MEMBERS + 8
    assert set(word.parts) == set(fitted.parts)
    sizes = fitted.points.max(1) - fitted.points.min(1)
    for number in range(MEMBERS):  # which lie as the family's points do
        shape = word.shapes[number]
        np.testing.assert_allclose(np.ptp(shape.verts, axis=0), sizes[number], atol=0.1)
        legs = shape.labels == word.parts.index("leg")
        heights = shape.verts[shape.faces].mean(1)[:, 1]
        assert heights[legs].mean() < heights[~legs].mean()


def test_another_collection_is_refused(chairs: tuple[bytes, bytes]) -> None:
    others = family("bicycles", 10)
    with pytest.raises(AssetError):
        family_meshes(chairs[0], zipped({each.name: each.glb() for each in others}))
