"""Previews: the bytes and positions of jobs that were not sent, whose assets are kept, and who may have how many."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import random
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi import FastAPI, Request

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.accessors import read_floats
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.children.asking import ChildLostError
from meshdeform.children.protocol import StoppedError
from meshdeform.children.warm import Asked, WarmProcesses
from meshdeform.client import AsyncClient, Client
from meshdeform.errors import AssetError, DependencyError, ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.mcp.tools import Folders, Tools
from meshdeform.requests.document import read_stored
from meshdeform.requests.previews import MOST_LEVELS, PreviewShapes
from meshdeform.runs import drafts, preview_work, start_run
from meshdeform.runs import reading as runs_reading
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.settings import Settings
from meshdeform.support.recent import Recent
from service.app import create_app
from service.http.auth import Principal, principal
from service.jobs import previews
from service.state import AppState
from tests import fake_exemplars
from tests.cases import each_case
from tests.integration import conftest
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem
from tests.unit.plain.test_change import two_nodes
from tests.waiting import until

BALL = icosphere(2)
ASSET = build_glb(BALL.verts, BALL.faces)
DIGEST = hashlib.sha256(ASSET).hexdigest()
GIVEN = {"guidance": {"source_noun": "pumpkin", "orientation": 0}}
_servers: list[FastAPI] = []


def named(request: Request) -> Principal:
    return Principal(owner_id=request.headers.get("x-owner", "ann"))


@pytest.fixture(scope="module")
def two(own_settings: Callable[..., Settings]) -> Iterator[tuple[Api, Api]]:
    """The same server, as two owners see it."""

    def application(settings: Settings) -> FastAPI:
        app = create_app(settings)
        app.dependency_overrides[principal] = named
        _servers.append(app)
        return app

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conftest, "create_app", application)
        with (
            conftest.serving_api(own_settings(max_upload_bytes=2**20)) as ann,
            httpx.Client(base_url=ann.url, timeout=240, headers={"x-owner": "bob"}) as other,
        ):
            yield ann, replace(ann, http=other)
    _servers.clear()


@pytest.fixture(autouse=True)
def _fitted_at_once(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    fake_exemplars.install(monkeypatch)
    monkeypatch.setattr(preview_work, "_recent", Recent(8, 2**20))
    yield
    fake_exemplars.FakeFit.made.clear()


def preview(
    api: Api, file: bytes | None = ASSET, form: str = "positions", *, draft: bool = False, **document: Any
) -> httpx.Response:
    body = {"prompt": "a giraffe", "params": GIVEN, **document}
    query = {"as": form, **({"draft": True} if draft else {})}
    if file is None:
        return api.http.post("/v1/jobs:preview", params=query, json=body)
    files = {"asset": ("a.glb", file), "request": (None, json.dumps(body))}
    return api.http.post("/v1/jobs:preview", params=query, files=files)


def shapes(answer: httpx.Response) -> PreviewShapes:
    assert answer.status_code == 200, answer.text
    return PreviewShapes.read(answer.content)


def places(glb: bytes) -> list[np.ndarray]:
    """The positions of a GLB's primitives, in order."""
    document = Document.parse(glb, Limits.unlimited(), glb=True)
    primitives = [each for mesh in document.root["meshes"] for each in mesh["primitives"]]
    return [read_floats(document, each["attributes"]["POSITION"]) for each in primitives]


def result_of_job(api: Api, asset: bytes, **document: Any) -> bytes:
    """The result.glb of a job with this request, run as a worker runs it."""
    body = {"prompt": "a giraffe", "params": GIVEN, **document}
    files = {"asset": ("a.glb", asset), "request": (None, json.dumps(body))}
    answer = api.http.post("/v1/jobs", files=files)
    assert answer.status_code == 202, answer.text
    job = api.record.get(answer.json()["id"])
    request = read_stored(job.request.model_dump(mode="json", exclude_unset=True))
    run = start_run(RunInput(request, {"asset": InputFile(asset, "a.glb", job.source.sha256)}, job.resolved))
    for _ in run:
        pass
    return run.finish()["result.glb"].data


def test_the_file_of_a_preview_has_the_bytes_of_its_job(two: tuple[Api, Api]) -> None:
    ann, _ = two
    found = preview(ann, form="glb", seeds=[3], output={"provenance": True})
    assert found.status_code == 200, found.text
    params = {**GIVEN, "seed": 3}
    assert found.content == result_of_job(ann, ASSET, params=params, output={"provenance": True})
    assert found.content != preview(ann, form="glb", seeds=[4], output={"provenance": True}).content
    assert len(ann.http.get("/v1/jobs").json()["jobs"]) == 1  # the one that was sent


def test_positions_are_those_of_the_results_within_half_a_step(two: tuple[Api, Api]) -> None:
    ann, _ = two
    asset = two_nodes("Plinth", "Head")
    found = shapes(preview(ann, asset, seeds=[0, 7, 0]))
    assert [each.seed for each in found.shapes] == [0, 7]
    assert (found.asset, found.change) == (hashlib.sha256(asset).hexdigest(), False)
    assert found.reading is not None
    assert found.reading["noun"] == "pumpkin"
    for shape in found.shapes:
        assert shape.member["noun"] == "giraffe"
        exact = places(preview(ann, asset, form="glb", seeds=[shape.seed]).content)
        assert [(each.mesh, each.primitive) for each in shape.primitives] == [(0, 0), (1, 0)]
        for primitive, points in zip(shape.primitives, exact, strict=True):
            half = np.ptp(points, axis=0) / MOST_LEVELS / 2
            assert (np.abs(np.array(primitive.points) - points) <= half * 1.01 + 1e-6).all()


def test_a_change_in_plain_words_is_the_same_with_all_seeds(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    found = shapes(preview(two[0], prompt="twice as tall", params={}, seeds=[0, 1]))
    assert found.change
    assert found.shapes[0].warnings == []
    (misread,) = shapes(preview(two[0], prompt="twice as talll", params={})).shapes[0].warnings
    assert "tall" in misread
    first, second = (each.primitives[0].values for each in found.shapes)
    assert first == second
    ball = load_asset(ASSET).surface.positions
    assert np.ptp(np.array(found.shapes[0].primitives[0].points), axis=0)[1] == pytest.approx(2 * np.ptp(ball[:, 1]))


def test_what_was_made_is_not_made_again_and_other_seeds_are(two: tuple[Api, Api]) -> None:
    ann, _ = two
    preview(ann, seeds=[0, 1])
    assert len(fake_exemplars.FakeFit.made) == 2
    preview(ann, form="glb", seeds=[1])
    assert len(fake_exemplars.FakeFit.made) == 2
    preview(ann, seeds=[1, 2], params={"guidance": {**GIVEN["guidance"], "strength": 0.5}})
    assert len(fake_exemplars.FakeFit.made) == 4


def test_the_next_prompt_names_the_asset_by_its_hash_and_only_its_owner_can(two: tuple[Api, Api]) -> None:
    ann, bob = two
    first = preview(ann)
    assert first.headers["meshdeform-asset"] == DIGEST
    kept = {"sha256": DIGEST.upper()}
    assert preview(ann, None, asset=kept).content == first.content
    check_problem(preview(bob, None, asset=kept), 404, "asset_not_kept")
    check_problem(preview(ann, None, asset={"sha256": "0" * 64}), 404, "asset_not_kept")
    assert check_problem(preview(ann, None, asset={"sha256": "0"}), 422, "parameter_invalid")["errors"]
    # What is kept for previews is nothing that a job could name.
    job = {"prompt": "a giraffe", "asset": kept}
    check_problem(ann.http.post("/v1/jobs", json=job), 422, "parameter_invalid")


def test_what_a_job_is_refused_for_a_preview_is(two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch) -> None:
    ann, _ = two
    check_problem(preview(ann, prompt="a xyzzy"), 422, "prompt_unknown_words")
    check_problem(preview(ann, prompt=""), 422, "prompt_invalid")
    check_problem(preview(ann, b"no asset"), 415, "asset_format")
    check_problem(preview(ann, params={"seed": -1}), 422, "parameter_invalid")
    check_problem(preview(ann, seeds=[-1]), 422, "parameter_invalid")
    check_problem(preview(ann, seeds=list(range(7))), 422, "parameter_invalid")
    check_problem(preview(ann, form="picture"), 422, "parameter_invalid")
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    problem = check_problem(preview(ann, prompt="a longer trunk", params={}), 422, "part_not_found")
    assert problem["parts"] == []


def test_only_what_takes_seconds_has_a_preview_and_a_file_has_one_shape(two: tuple[Api, Api]) -> None:
    ann, _ = two
    problem = check_problem(preview(ann, params={"guidance": {"kind": "sds"}}), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["params", "guidance", "kind"]
    check_problem(preview(ann, kind="surface_fit", prompt="", params={}), 422, "parameter_invalid")
    problem = check_problem(preview(ann, form="glb", seeds=[0, 1]), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["seeds"]


def test_a_draft_is_the_whole_surface_unmended_and_the_exact_shape_is_remembered(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, _ = two
    answer = preview(ann, draft=True)
    assert (answer.headers["meshdeform-draft"], shapes(answer).draft) == ("true", True)
    (fit,) = fake_exemplars.FakeFit.made
    assert (len(fit.faces), fit.mends) == (len(BALL.faces), False)
    exact = preview(ann)
    assert exact.headers["meshdeform-draft"] == "false"
    assert [fit.mends for fit in fake_exemplars.FakeFit.made] == [False, True]
    assert preview(ann, draft=True).content == exact.content
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    change = preview(ann, prompt="twice as tall", params={}, draft=True)
    assert change.headers["meshdeform-draft"] == "false"


def test_of_a_large_asset_a_draft_has_the_same_vertices_near_where_they_will_be(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, _ = two
    asset = two_nodes("Plinth", "Head")
    monkeypatch.setattr(drafts, "_LARGE", 100)
    monkeypatch.setattr(drafts, "_FACES", 100)
    monkeypatch.setattr(preview_work, "_recent", Recent(8, 2**20))
    fake_exemplars.FakeFit.made.clear()
    answer = preview(ann, asset, draft=True)
    first, glb = shapes(answer), places(preview(ann, asset, form="glb", draft=True).content)
    assert (answer.headers["meshdeform-draft"], first.draft) == ("true", True)
    (fit,) = fake_exemplars.FakeFit.made
    assert (len(fit.faces) < 200, 0 if fit.labels is None else len(fit.labels), fit.mends) == (
        True,
        len(fit.faces),
        False,
    )
    exact = preview(ann, asset)
    assert (exact.headers["meshdeform-draft"], shapes(exact).draft) == ("false", False)
    for one, other, file in zip(first.shapes[0].primitives, shapes(exact).shapes[0].primitives, glb, strict=True):
        assert np.ptp(np.array(one.points), axis=0) == pytest.approx(np.ptp(file, axis=0), rel=1e-3)
        size = np.linalg.norm(np.ptp(np.array(other.points), axis=0))
        apart = np.linalg.norm(np.array(one.points) - np.array(other.points), axis=1)
        assert 0 < apart.max() < 0.1 * size
    assert preview(ann, asset, draft=True).content == exact.content  # which is remembered


class Holding:
    """Processes that answer when they are let."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[Asked] = []
        self.let = threading.Event()
        monkeypatch.setattr(WarmProcesses, "ask", lambda _processes, *arguments: self._ask(*arguments))

    def _ask(self, _owner: str, task: dict[str, Any], _timeout_s: float, asked: Asked) -> dict[str, Any]:
        self.asked.append(asked)
        until(lambda: self.let.is_set() or asked.stopped)
        if asked.stopped:
            raise StoppedError
        Path(task["result"]).write_bytes(b"made")
        return {"draft": False}


def test_more_previews_than_there_may_be_are_refused_until_there_is_room(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, bob = two
    holding = Holding(monkeypatch)
    monkeypatch.setattr(previews, "_SOON_S", 0.05)
    threads = [threading.Thread(target=preview, args=(each,)) for each in two]
    for number, thread in enumerate(threads):
        thread.start()
        until(lambda number=number: len(holding.asked) > number)
    for api in (ann, bob):
        answer = preview(api)
        check_problem(answer, 429, "rate_limited")
        assert int(answer.headers["retry-after"]) >= 1
    holding.let.set()
    for thread in threads:
        thread.join()
    assert preview(ann).content == b"made"


def test_a_change_in_plain_words_does_not_wait_for_fits(two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs_reading, "read_source", lambda *_: None)
    ask, let, asked = WarmProcesses.ask, threading.Event(), list[str]()

    def held(processes: WarmProcesses, copy: str, task: dict[str, Any], timeout_s: float, taken: Asked) -> Any:
        asked.append(copy)
        if "giraffe" in task["request"]["prompt"]:
            until(let.is_set)
        return ask(processes, copy, task, timeout_s, taken)

    monkeypatch.setattr(WarmProcesses, "ask", held)
    threads = [threading.Thread(target=preview, args=(each,)) for each in two]
    for number, thread in enumerate(threads):  # which take all slots of fits
        thread.start()
        until(lambda number=number: len(asked) > number)
    assert shapes(preview(two[0], prompt="twice as tall", params={})).change
    assert sorted(asked)[0] == "ann"  # whose other process has made the change
    assert len(set(asked)) == 3
    let.set()
    for thread in threads:
        thread.join()


def test_the_work_ends_when_the_caller_goes(two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch) -> None:
    ann, _ = two
    holding = Holding(monkeypatch)

    async def give_up() -> None:
        async with httpx.AsyncClient(base_url=ann.url, timeout=240) as client:
            sent = {"data": base64.b64encode(ASSET).decode()}
            body = {"prompt": "a giraffe", "params": GIVEN, "asset": sent}
            call = asyncio.create_task(client.post("/v1/jobs:preview", json=body))
            while not holding.asked:
                await asyncio.sleep(0.01)
            call.cancel()

    asyncio.run(give_up())
    until(lambda: holding.asked[0].stopped)
    holding.let.set()
    assert preview(ann).content == b"made"  # its slot is free


def test_a_flood_of_many_owners_leaves_each_its_own_and_nothing_behind(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some close early, some send what is no mesh, some name the assets of others."""
    ann, _ = two
    app: AppState = _servers[0].state.app_state
    monkeypatch.setattr(app.kept_assets, "_most_bytes", 10 * len(ASSET))
    running, most = [0], [0]

    def told(_: WarmProcesses, owner: str, task: dict[str, Any], __: float, asked: Asked) -> dict[str, Any]:
        running[0] += 1
        most[0] = max(most[0], running[0])
        data = Path(task["files"]["asset"]["path"]).read_bytes()
        Path(task["result"]).write_text(f"{owner} {hashlib.sha256(data).hexdigest()}")
        until(lambda: asked.stopped or chance.random() < 0.3)
        running[0] -= 1
        if asked.stopped:
            raise StoppedError
        return {"draft": False}

    chance = random.Random(1)
    monkeypatch.setattr(WarmProcesses, "ask", told)
    assets = {f"owner{k}": build_glb(BALL.verts * (1 + k / 50), BALL.faces) for k in range(20)}
    hashes = {owner: hashlib.sha256(asset).hexdigest() for owner, asset in assets.items()}

    def attack(job: tuple[int, str]) -> None:
        turn, owner = job
        with httpx.Client(base_url=ann.url, timeout=240, headers={"x-owner": owner}) as http:
            me, other = replace(ann, http=http), hashes[f"owner{(int(owner[5:]) + 1) % 20}"]
            if turn == 0:  # closes early
                http.timeout = 0.05
                with suppress(httpx.TimeoutException):
                    preview(me, assets[owner])
            elif turn == 1:
                assert 400 <= preview(me, assets[owner][: 100 + int(owner[5:])]).status_code < 500
            elif turn == 2:
                assert preview(me, None, asset={"sha256": other}).status_code in (404, 429)
            elif (answer := preview(me, assets[owner])).status_code != 429:
                assert answer.text == f"{owner} {hashes[owner]}"

    with ThreadPoolExecutor(16) as threads:
        list(threads.map(attack, [(turn, owner) for turn in range(5) for owner in assets]))
    assert most[0] <= 2
    kept = list((app.workspace.folder / "kept").iterdir())
    assert sum(file.stat().st_size for file in kept) <= 10 * len(ASSET)
    left = {path.name for path in app.workspace.folder.iterdir() if path.name.startswith("tmp")}
    assert until(lambda: not left or not any((app.workspace.folder / name).exists() for name in left))
    assert preview(replace(ann, http=ann.http), assets["owner1"]).text.startswith("ann ")


def test_a_process_that_dies_or_takes_too_long_is_said_to(
    two: tuple[Api, Api], monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, _ = two
    failures = iter([ChildLostError(), TimeoutError(), DependencyError("scipy is not installed.")])

    def fail(*_: Any) -> None:
        raise next(failures)

    monkeypatch.setattr(WarmProcesses, "ask", fail)
    assert "has ended" in check_problem(preview(ann), 503, "unavailable")["detail"]
    assert "longer than" in check_problem(preview(ann), 503, "unavailable")["detail"]
    assert "deform" in check_problem(preview(ann), 501, "dependency_missing")["detail"]


def test_the_reading_of_a_preview_is_kept_for_the_job(two: tuple[Api, Api]) -> None:
    ann, _ = two
    before = len(list(ann.store.list("readings/")))
    shapes(preview(ann, build_glb(1.2 * BALL.verts, BALL.faces)))
    assert len(list(ann.store.list("readings/"))) == before + 1


def test_the_state_has_nothing_of_a_preview(two: tuple[Api, Api]) -> None:
    ann, _ = two
    state: AppState = _servers[-1].state.app_state
    assets = len(list(ann.store.list("assets/")))
    other = build_glb(1.1 * BALL.verts, BALL.faces)
    shapes(preview(ann, other))
    assert len(list(ann.store.list("assets/"))) == assets
    assert not list(state.workspace.folder.glob("tmp*"))


def test_a_client_sends_a_file_once_and_again_when_it_was_forgotten(two: tuple[Api, Api]) -> None:
    ann, _ = two
    sizes: list[int] = []

    def note(request: httpx.Request) -> None:
        sizes.append(int(request.headers.get("content-length", 0)))

    asset = build_glb(1.3 * BALL.verts, BALL.faces)
    with httpx.Client(base_url=ann.url, timeout=240, event_hooks={"request": [note]}) as http:
        client = Client(http=http)
        found = client.preview(asset, "a giraffe", params=GIVEN, seeds=[0, 1])
        assert [each.seed for each in found.shapes] == [0, 1]
        glb = client.preview_glb(asset, "a giraffe", params={**GIVEN, "seed": 1})
        near = np.array(found.shapes[1].primitives[0].points)
        np.testing.assert_allclose(near, places(glb)[0], atol=1e-3)
        assert [size > len(asset) for size in sizes] == [True, False]
        _servers[-1].state.app_state.kept_assets._files.clear()
        sizes.clear()
        assert client.preview_glb(asset, "a giraffe", params={**GIVEN, "seed": 1}) == glb
        assert [size > len(asset) for size in sizes] == [False, True]


@each_case("damage", {"cut off": slice(0, -1), "no header": slice(0, 8), "another file": slice(4, None)})
def test_a_damaged_answer_is_no_preview(two: tuple[Api, Api], damage: str) -> None:
    whole = preview(two[0]).content
    assert PreviewShapes.read(whole).shapes
    cut = {"cut off": slice(0, -1), "no header": slice(0, 8), "another file": slice(4, None)}[damage]
    with pytest.raises(AssetError):
        PreviewShapes.read(whole[cut])


def test_an_agent_tries_a_prompt_before_it_starts_a_job(two: tuple[Api, Api], tmp_path: Path) -> None:
    ann, _ = two
    (tmp_path / "ball.glb").write_bytes(ASSET)
    tools = Tools(lambda _: AsyncClient(ann.url), Folders([tmp_path]))
    context: Any = None
    told = asyncio.run(tools.try_prompt("ball.glb", "a giraffe", "try.glb", context, params=GIVEN))
    assert (tmp_path / "try.glb").read_bytes() == preview(ann, form="glb").content
    assert told == {"path": str(tmp_path / "try.glb"), "bytes": (tmp_path / "try.glb").stat().st_size}
    with pytest.raises(ParameterError):  # nothing is overwritten
        asyncio.run(tools.try_prompt("ball.glb", "a giraffe", "try.glb", context, params=GIVEN))
