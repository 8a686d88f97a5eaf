"""Drawings over HTTP: what they may show, the meshes of corrected parameters, and jobs whose target is drawn."""

from __future__ import annotations

import asyncio
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets.limits import run_child
from meshdeform.client import AsyncClient, Client, SketchGuesses
from meshdeform.errors import DrawingError, ParameterError
from meshdeform.kinds.sketch.families import member_glb
from meshdeform.kinds.sketch.looking import guess
from meshdeform.requests.sketches import Sketch
from meshdeform.runs import questions, sketch_process
from tests.drawings import blank_page, drawing_of
from tests.integration.conftest import DEADLINE_S, Api
from tests.integration.http_calls import check_document, check_problem

BINARY = {"Content-Type": "application/octet-stream"}


@cache
def vase() -> bytes:
    """A drawing of a vase."""
    return drawing_of("vase")


def test_guesses_have_parameters_with_ranges_and_meshes(api: Api, openapi: dict[str, Any], tmp_path: Path) -> None:
    answer = api.http.post("/v1/sketches:guess", content=vase(), headers=BINARY)
    assert answer.status_code == 200, answer.text
    check_document(answer.json(), "SketchGuesses", openapi)
    expected = guess(vase())
    found = SketchGuesses.model_validate(answer.json())
    assert [(each.family, each.probability, each.values, each.glb) for each in found.guesses] == [
        (each.family, each.probability, each.values, each.glb()) for each in expected
    ]
    assert (found.guesses[0].family, found.unsure) == ("vase", False)
    named = {each.name: each for each in found.guesses[0].parameters}
    assert (named["lip"].minimum, named["lip"].maximum, named["lip"].default) == (0.08, 0.3, 0.16)
    assert named["handles"].options == ["none", "one", "two"]
    drawing = tmp_path / "drawing.png"
    drawing.write_bytes(vase())
    with Client(api.url) as client:
        (only,) = client.guess_sketch(drawing, family="lamp").guesses
        assert only.family == "lamp"
        with pytest.raises(DrawingError, match="empty"):
            client.guess_sketch(blank_page())

    async def ask() -> tuple[SketchGuesses, bytes]:
        async with AsyncClient(api.url) as client:
            return await client.guess_sketch(vase()), await client.make_sketch_mesh("lamp")

    assert asyncio.run(ask()) == (found, member_glb("lamp", {}))


def test_corrected_parameters_make_a_mesh(api: Api) -> None:
    sketch = {"family": "vase", "values": {"lip": 0.2, "handles": "two"}}
    answer = api.http.post("/v1/sketches:mesh", json=sketch)
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.content == member_glb("vase", sketch["values"])
    with Client(api.url) as client:
        assert client.make_sketch_mesh("vase", {"lip": 0.2, "handles": "two"}) == answer.content
        with pytest.raises(ParameterError, match=r"lip is 7\.0, but it must be a number from 0\.08 to 0\.3"):
            client.make_sketch_mesh("vase", {"lip": 7})


def test_what_cannot_be_read_is_refused(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    check_problem(api.http.post("/v1/sketches:guess", content=b"no picture", headers=BINARY), 422, "not_a_drawing")
    check_problem(api.http.post("/v1/sketches:guess", content=b"", headers=BINARY), 422, "not_a_drawing")
    wrong = api.http.post("/v1/sketches:guess?family=sofa", content=vase(), headers=BINARY)
    assert "chair" in check_problem(wrong, 422, "parameter_invalid")["advice"]
    monkeypatch.setattr("service.sketches.routes._MAX_BYTES", 100)
    check_problem(api.http.post("/v1/sketches:guess", content=vase(), headers=BINARY), 422, "not_a_drawing")


def test_a_child_makes_the_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "run_child", run_child)
    sketch = Sketch(family="table")
    assert sketch_process.shape_of(sketch, tmp_path, timeout_s=DEADLINE_S) == member_glb("table", {})
