"""Drawings over HTTP: what they may show, the meshes of moved sliders, and words of the owner's."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from meshdeform.children.asking import run_child
from meshdeform.client import AsyncClient, Client, SketchGuesses
from meshdeform.errors import DrawingError, ParameterError
from meshdeform.kinds.sketch import process as sketch_process
from meshdeform.kinds.sketch.guessing import guess
from meshdeform.kinds.sketch.shapes import shape_glb
from meshdeform.kinds.sketch.sliders import Sketch
from meshdeform.runs import questions
from tests.drawings import blank_page, drawing_of
from tests.integration.conftest import DEADLINE_S, Api
from tests.integration.http_calls import check_document, check_problem

BINARY = {"Content-Type": "application/octet-stream"}


def test_guesses_have_sliders_with_ranges_and_meshes(api: Api, openapi: dict[str, Any], tmp_path: Path) -> None:
    giraffe = drawing_of("giraffe")
    answer = api.http.post("/v1/sketches:guess", content=giraffe, headers=BINARY)
    assert answer.status_code == 200, answer.text
    check_document(answer.json(), "SketchGuesses", openapi)
    found = SketchGuesses.model_validate(answer.json())
    assert [(each.noun, each.probability, each.values, each.glb) for each in found.guesses] == [
        (each.noun, each.probability, each.values, each.glb()) for each in guess(giraffe)
    ]
    assert found.guesses[0].noun == "giraffe"
    named = {each.name: each for each in found.guesses[0].parameters}
    assert (named["neck"].minimum, named["neck"].maximum, named["neck"].default) == (-1, 1, 0)
    assert named["kind"].options == ["giraffe"]
    drawing = tmp_path / "drawing.png"
    drawing.write_bytes(giraffe)
    with Client(api.url) as client:
        (only,) = client.guess_sketch(drawing, noun="llama").guesses
        assert only.noun == "llama"
        with pytest.raises(DrawingError, match="empty"):
            client.guess_sketch(blank_page())


def test_moved_sliders_make_a_mesh(api: Api) -> None:
    sketch = {"noun": "vase", "values": {"neck": 0.5, "height": 1.2}}
    answer = api.http.post("/v1/sketches:mesh", json=sketch)
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.content == shape_glb("vase", sketch["values"])
    with Client(api.url) as client:
        assert client.make_sketch_mesh("vase", {"neck": 0.5, "height": 1.2}) == answer.content
        with pytest.raises(ParameterError, match=r"neck is 7\.0, but it must be a number from -1 to 1"):
            client.make_sketch_mesh("vase", {"neck": 7})

    async def ask() -> bytes:
        async with AsyncClient(api.url) as client:
            return await client.make_sketch_mesh("lamp")

    assert asyncio.run(ask()) == shape_glb("lamp", {})


def test_what_cannot_be_read_is_refused(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    check_problem(api.http.post("/v1/sketches:guess", content=b"no picture", headers=BINARY), 422, "not_a_drawing")
    check_problem(api.http.post("/v1/sketches:guess", content=b"", headers=BINARY), 422, "not_a_drawing")
    wrong = api.http.post("/v1/sketches:guess?noun=justice", content=drawing_of("vase"), headers=BINARY)
    assert "justice" in check_problem(wrong, 422, "parameter_invalid")["detail"]
    monkeypatch.setattr("meshdeform.kinds.sketch.routes._MAX_BYTES", 100)
    check_problem(api.http.post("/v1/sketches:guess", content=drawing_of("vase"), headers=BINARY), 422, "not_a_drawing")


def test_a_child_makes_the_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "run_child", run_child)
    made = sketch_process.shape_of(Sketch(noun="seat"), tmp_path, timeout_s=DEADLINE_S)
    assert made == shape_glb("chair", {})
