"""Drawings over HTTP: what they may show, the meshes of corrected parameters, and jobs whose target is drawn."""

from __future__ import annotations

import asyncio
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets import load_asset
from meshdeform.assets.isolation import ChildOutcome, run_child
from meshdeform.client import AsyncClient, Client, SketchGuesses
from meshdeform.errors import DependencyError, DrawingError, ParameterError
from meshdeform.requests.sketches import Sketch
from meshdeform.runs import questions, sketch_process, start_run
from meshdeform.settings import Settings
from meshdeform.sketch.guesses import guess
from meshdeform.sketch.members import member_glb
from tests.drawings import blank_page, drawing_of
from tests.integration.conftest import DEADLINE_S, Api, serving
from tests.integration.http_calls import check_document, check_problem
from tests.worker_world import working

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
    large = check_problem(api.http.post("/v1/sketches:guess", content=vase(), headers=BINARY), 422, "not_a_drawing")
    assert "larger than 100 bytes" in large["detail"]


def test_a_server_without_numpy_says_so(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = {
        "ok": False,
        "error": {"code": DependencyError.code, "detail": "numpy is not installed.", "advice": "", "extra": {}},
    }
    monkeypatch.setattr(questions, "run_child", lambda *_a, **_k: ChildOutcome(1, verdict))
    problem = check_problem(
        api.http.post("/v1/sketches:guess", content=vase(), headers=BINARY), 500, DependencyError.code
    )
    assert "numpy is not installed" in problem["detail"]
    assert "meshdeform sketch" in problem["advice"]


def test_a_child_makes_the_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "run_child", run_child)
    sketch = Sketch(family="table")
    assert sketch_process.shape_of(sketch, tmp_path, timeout_s=DEADLINE_S) == member_glb("table", {})


def test_a_drawing_is_checked_with_its_job(api: Api, sphere: bytes) -> None:
    def sent(drawing: bytes, **params: Any) -> Any:
        document = json.dumps({"params": {"guidance": "target", "preset": "preview", **params}})
        files = {"asset": ("a.glb", sphere), "sketch": ("vase.png", drawing), "request": (None, document)}
        return api.http.post("/v1/jobs:validate", files=files)

    found = sent(vase())
    assert found.status_code == 200, found.text
    picture = found.json()["pictures"]["sketch"]
    assert (picture["format"], picture["width"], picture["height"]) == ("png", 300, 300)
    assert 0 < picture["box"][0] < picture["box"][2] < 1
    problem = check_problem(sent(blank_page()), 422, "not_a_drawing")
    assert "`sketch`" in problem["detail"]
    check_problem(sent(vase(), guidance="sds"), 422, "parameter_invalid")
    wrong = check_problem(sent(vase(), sketch={"family": "vase", "values": {"legs": "four"}}), 422, "parameter_invalid")
    assert wrong["errors"][0]["loc"] == ["params", "sketch"]


def test_a_worker_fits_the_asset_to_the_drawn_shape(tmp_path: Path, redis_url: str, sphere: bytes) -> None:
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-sketch")
    asset, drawing = tmp_path / "sphere.glb", tmp_path / "my vase.png"
    asset.write_bytes(sphere)
    drawing.write_bytes(vase())
    corrected = {"family": "vase", "values": {"handles": "two"}}
    params = {"preset": "preview", "steps": 2, "guidance": "target", "sketch": corrected}
    with serving(settings) as url, working(settings, start_run), Client(url) as client:
        job = client.submit(asset, params=params, files={"sketch": drawing})
        assert list(job.files) == ["asset", "sketch"]
        done = client.wait(job, timeout_s=DEADLINE_S)
        assert done.state.value == "succeeded", done.error
        report = json.loads(client.read(job, "report.json"))
        target = client.read(job, "target.glb")
    first = guess(vase())[0]
    assert report["sketch"] == {
        "family": "vase",
        "values": {**first.values, "handles": "two"},
        "probability": first.probability,
    }
    assert target == member_glb("vase", report["sketch"]["values"])
    assert 0 < report["fit"]["silhouettes"] <= 1
    assert len(load_asset(target).surface.triangles) > 100
