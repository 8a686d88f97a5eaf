"""Words of owners' own at the service: made, imported, listed, exported, drawn and deleted, and pinned by jobs."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from meshdeform.assets import build_glb
from meshdeform.errors import NotFoundError
from meshdeform.record.models import JobState
from meshdeform.record.reconciler import remove_unreachable
from meshdeform.runs.word_pins import pins_of
from meshdeform.settings import Settings
from meshdeform.words import MAX_WORDS, Word, joined, read_words
from tests.cases import each_case
from tests.claims import claim_job
from tests.client_flavors import FLAVORS, opened
from tests.integration.conftest import Api, serving_api
from tests.integration.http_calls import check_document, check_problem, finished_job, post
from tests.unit.cli.lines import done
from tests.unit.words.words import BOX, WEDGE, box, word
from tests.waiting import until

FRUIT = word("dragon-fruit", box(1, 2, 3), synonyms=("pitaya",))
OTHER = word("dragon-fruit", box(3, 2, 1))
FILES = "assets/"


def mesh(x: float = 1.0, y: float = 1.0, z: float = 1.0) -> bytes:
    """A GLB of a box of these sides."""
    shape = box(x, y, z)
    return build_glb(shape.verts, shape.faces)


def send(api: Api, *files: tuple[str, str, bytes], **document: Any) -> httpx.Response:
    """Send parts, each its name, its file's name and its bytes, and a document."""
    parts: list[tuple[str, Any]] = [(name, (filename, data)) for name, filename, data in files]
    return api.http.post("/v1/words", files=[*parts, ("request", (None, json.dumps(document)))])


def given(api: Api, *words: Word, **document: Any) -> httpx.Response:
    """Import words."""
    return send(api, ("word", "some.word", joined(words)), **document)


def nouns(api: Api) -> list[str]:
    return [each["noun"] for each in api.http.get("/v1/words").json()["words"]]


def objects(api: Api) -> set[str]:
    return {key for key, _ in api.store.list(FILES)}


@pytest.fixture
def own(api: Api) -> Iterator[Api]:
    """The API, without words before and after."""
    yield api
    for noun in nouns(api):
        assert api.http.delete(f"/v1/words/{noun}").status_code == 204


def test_meshes_become_a_word_with_what_is_said_of_it(own: Api, openapi: dict[str, Any]) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("more/c.glb", mesh(1, 2, 2))
        archive.writestr("more/d.glb", mesh(1, 2, 4))
    files = [("meshes", "a.glb", mesh(1, 2, 3)), ("meshes", "a.glb", mesh(1, 2, 2.5))]
    said = {"noun": "Dragon Fruit", "synonyms": ["pitaya"], "like": "apples", "front": 0, "licence": "CC0"}
    answer = send(own, *files, ("meshes", "more.zip", packed.getvalue()), **said)
    assert answer.status_code == 201, answer.text
    (view,) = answer.json()["words"]
    check_document(answer.json(), "WordList", openapi)
    assert (view["noun"], view["synonyms"], view["like"], view["meshes"]) == ("dragon-fruit", ["pitaya"], "apple", 4)
    detail = own.http.get("/v1/words/dragon-fruit").json()
    check_document(detail, "WordDetail", openapi)
    assert [each["source"] for each in detail["sources"]] == ["a.glb", "2-a.glb", "more/c.glb", "more/d.glb"]
    assert {each["licence"] for each in detail["sources"]} == {"CC0"}
    assert own.http.get("/v1/words").json() == answer.json()


def test_a_word_of_a_result_and_of_an_upload(own: Api) -> None:
    job = finished_job(own, mesh(1, 2, 3))
    answer = own.http.post("/v1/words", json={"noun": "gizmo", "meshes": [{"job_id": job}], "front": 0})
    assert answer.status_code == 201, answer.text
    assert own.http.get("/v1/words/gizmo").json()["sources"][0]["source"] == "result.glb"


def test_an_exported_word_is_the_same_elsewhere(own: Api) -> None:
    view = given(own, FRUIT, BOX).json()["words"]
    assert [each["sha256"] for each in view] == [BOX.sha256, FRUIT.sha256]
    content = own.http.get("/v1/words/dragon-fruit/content")
    assert content.content == FRUIT.data
    assert content.headers["etag"] == f'"{FRUIT.sha256}"'
    assert own.http.delete("/v1/words/dragon-fruit").status_code == 204
    check_problem(own.http.get("/v1/words/dragon-fruit/content"), 404, "not_found")
    assert send(own, ("word", "a.word", content.content)).json()["words"][0]["sha256"] == FRUIT.sha256
    picture = own.http.get("/v1/words/dragon-fruit/picture.png")
    assert picture.content.startswith(b"\x89PNG")
    again = own.http.get("/v1/words/dragon-fruit/picture.png", headers={"If-None-Match": picture.headers["etag"]})
    assert again.status_code == 304


DAMAGED = bytearray(FRUIT.data)
DAMAGED[-4:] = np.array([np.nan], "<f4").tobytes()


@each_case(
    ("files", "document", "code"),
    [
        ([("meshes", "a.glb", mesh()), ("meshes", "b.glb", mesh()[:-9])], {"noun": "gizmo"}, "asset_truncated"),
        ([("meshes", "a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n")], {"noun": "gizmo"}, "asset_no_triangles"),
        ([("word", "a.word", FRUIT.data[:-5])], {}, "asset_invalid"),
        ([("word", "a.word", bytes(DAMAGED))], {}, "asset_invalid"),
        ([("word", "a.word", mesh())], {}, "asset_format"),
        ([("word", "a.word", FRUIT.data)], {"noun": "gizmo"}, "parameter_invalid"),
        ([("meshes", "a.glb", mesh())], {"noun": "mushroom"}, "parameter_invalid"),
        ([("meshes", "a.glb", mesh())], {"noun": "gizmo", "synonyms": ["wedges"]}, "parameter_invalid"),
        ([("meshes", "a.glb", mesh())], {"noun": "gizmo", "like": "gadget"}, "parameter_invalid"),
        ([("meshes", "a.glb", mesh())], {"noun": "gizmo", "fronts": {"b.glb": 90}}, "parameter_invalid"),
        ([], {"noun": "gizmo"}, "parameter_invalid"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_is_kept(
    own: Api, files: list[Any], document: dict[str, Any], code: str
) -> None:
    given(own, WEDGE)
    before = objects(own)
    answer = send(own, *files, **document)
    check_problem(answer, 415 if code == "asset_format" else 422, code)
    assert nouns(own) == ["wedge"]
    assert objects(own) == before


def test_a_noun_is_replaced_only_if_that_is_said_and_its_content_goes(own: Api) -> None:
    given(own, FRUIT)
    check_problem(given(own, OTHER), 422, "parameter_invalid")
    assert given(own, OTHER, replace=True).status_code == 201
    assert own.http.get("/v1/words/dragon-fruit").json()["sha256"] == OTHER.sha256
    assert not own.store.exists(FILES + FRUIT.sha256)
    assert own.http.delete("/v1/words/dragon-fruit").status_code == 204
    assert not own.store.exists(FILES + OTHER.sha256)


def test_a_repeated_request_makes_a_word_once(own: Api) -> None:
    files: Any = [("word", ("a.word", FRUIT.data)), ("request", (None, "{}"))]
    first, second = (own.http.post("/v1/words", files=files, headers={"Idempotency-Key": "once"}) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 201)
    assert second.headers["idempotency-replayed"] == "true"
    assert second.json() == first.json()


def pinned(api: Api, job_id: str) -> tuple[dict[str, str], list[Word]]:
    """The words that a job pins, and those of its part."""
    job = api.record.get(job_id)
    return pins_of(job.request), read_words(api.store.get(job.files["words"].key))


def test_a_job_keeps_its_word_when_it_is_replaced_and_deleted(own: Api) -> None:
    given(own, FRUIT)
    job = post(own, mesh(), {"prompt": "a tall pitaya"}).json()
    assert job["params"]["guidance"]["words"] == {"dragon-fruit": FRUIT.sha256}
    given(own, OTHER, replace=True)
    later = post(own, mesh(), {"prompt": "a tall dragon fruit"}).json()
    assert own.http.delete("/v1/words/dragon-fruit").status_code == 204
    assert pinned(own, job["id"]) == ({"dragon-fruit": FRUIT.sha256}, [FRUIT])
    assert pinned(own, later["id"]) == ({"dragon-fruit": OTHER.sha256}, [OTHER])
    check_problem(post(own, mesh(), {"prompt": "a tall pitaya"}), 422, "prompt_unknown_words")
    # A retry has what its job has, whatever there is now.
    given(own, OTHER)
    assert own.http.post(f"/v1/jobs/{job['id']}/cancel").json()["state"] == "canceled"
    again = own.http.post(f"/v1/jobs/{job['id']}/retry")
    assert again.status_code == 202, again.text
    assert pinned(own, again.json()["id"]) == ({"dragon-fruit": FRUIT.sha256}, [FRUIT])


def test_a_branch_has_the_words_of_its_job_and_further_ones(own: Api) -> None:
    given(own, FRUIT, BOX)
    posted = post(own, mesh(), {"prompt": "a pitaya"}).json()
    asked = own.record.get(posted["id"])
    assert claim_job(own.record.leases, asked.id, "worker", 60.0)
    state = own.store.put(f"jobs/{asked.id}/1/checkpoint-000010", b"ten")
    own.record.leases.set_checkpoint(asked.id, 1, f"jobs/{asked.id}/1/checkpoint-000010", 10, state.sha256)
    own.record.leases.finish(asked.id, 1, JobState.FAILED)
    given(own, OTHER, replace=True)
    branch = own.http.post(f"/v1/jobs/{asked.id}/checkpoints/10/branch", json={"prompt": "a tall pitaya"})
    assert branch.status_code == 202, branch.text
    assert pinned(own, branch.json()["id"])[1] == [FRUIT]
    other = own.http.post(f"/v1/jobs/{asked.id}/checkpoints/10/branch", json={"prompt": "a dragon box"})
    assert pinned(own, other.json()["id"]) == ({"dragon-box": BOX.sha256}, [BOX])


def test_words_that_are_sent_with_a_job_need_not_be_kept(own: Api) -> None:
    request = {
        "prompt": "a pitaya",
        "params": {"guidance": {"kind": "exemplar", "words": {"dragon-fruit": FRUIT.sha256}}},
    }
    check_problem(post(own, mesh(), request), 422, "parameter_invalid")
    answer = post(own, mesh(), request, words=("w.word", FRUIT.data))
    assert answer.status_code == 202, answer.text
    assert pinned(own, answer.json()["id"])[1] == [FRUIT]
    checked = own.http.post(
        "/v1/jobs:validate",
        files={"asset": ("a.glb", mesh()), "request": (None, json.dumps(request)), "words": ("w.word", b"none")},
    )
    check_problem(checked, 415, "asset_format")


def test_parts_and_validation_know_the_words(own: Api) -> None:
    given(own, WEDGE)
    request = {"prompt": "", "params": {"guidance": {"source_noun": "wedge", "orientation": 0}}}
    files: Any = {"asset": ("a.glb", mesh(1, 2, 3)), "request": (None, json.dumps(request))}
    found = own.http.post("/v1/jobs:parts", files=files)
    assert found.status_code == 200, found.text
    assert found.json()["reading"]["noun"] == "wedge"
    files["request"] = (None, json.dumps({"prompt": "a tall doorstop"}))
    checked = own.http.post("/v1/jobs:validate", files=files).json()
    assert checked["params"]["words"] == {"wedge": WEDGE.sha256}
    assert list(checked["files"]) == ["asset"]


def test_parts_know_words_that_the_request_does_not_name(own: Api) -> None:
    given(own, WEDGE)
    files: Any = {"asset": ("a.glb", mesh(1, 2, 3)), "request": (None, json.dumps({"prompt": ""}))}
    found = own.http.post("/v1/jobs:parts", files=files)
    assert found.status_code == 200, found.text
    assert "wedge" in {each["noun"] for each in found.json()["reading"]["nouns"]}


def test_models_say_what_there_are_shapes_of_with_ones_own_first(own: Api, openapi: dict[str, Any]) -> None:
    given(own, WEDGE)
    found = own.http.get("/v1/models").json()
    check_document(found, "ModelList", openapi)
    shapes, builtin = found["shapes"], found["models"][0]["vocabulary"]
    assert shapes["nouns"][0] == "wedge"
    assert shapes["groups"]["yours"] == ["wedge"]
    assert shapes["parts"]["wedge"] == ["head"]
    assert set(builtin["nouns"]) < set(shapes["nouns"])
    assert sum(map(len, shapes["groups"].values())) == len(shapes["nouns"])


@each_case("flavor", FLAVORS)
def test_clients_add_list_export_and_delete(own: Api, flavor: str, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(mesh(1, 2, 3))
    with opened(flavor, own.url) as client:
        made = client.add_word(
            "Dragon Fruit", [tmp_path / "a.glb", mesh(1, 2, 2)], synonyms=["pitaya"], like="apple", front=0
        )
        assert client.words() == [made]
        assert [each.source for each in client.word("dragon-fruit").sources] == ["a.glb", "asset.glb"]
        data = client.export_word(made.noun)
        client.delete_word(made.noun)
        assert [each.sha256 for each in client.import_words(data)] == [made.sha256]
        assert client.import_words(data, replace=True)[0].synonyms == ["pitaya"]
        assert client.draw_word(made.noun).startswith(b"\x89PNG")
        client.delete_word(made.noun)
        with pytest.raises(NotFoundError):
            client.word(made.noun)


def test_the_command_line_keeps_words_at_a_service(own: Api, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(mesh(1, 2, 3))
    at = f"--url {own.url}"
    done(f"words add {tmp_path / 'a.glb'} --noun okapi --like horse --front 0 {at}")
    assert "okapi" in done(f"words list {at}").stdout
    assert "a.glb" in done(f"words show okapi --picture {tmp_path / 'okapi.png'} {at}").stdout
    done(f"words export okapi -o {tmp_path / 'okapi.word'} {at}")
    done(f"words remove okapi {at}")
    done(f"words import {tmp_path / 'okapi.word'} {at}")
    assert nouns(own) == ["okapi"]


def test_the_limits_of_an_owner(own_settings: Callable[..., Settings]) -> None:
    assert Settings.model_fields["max_words"].default == MAX_WORDS
    size = len(FRUIT.data)
    with serving_api(own_settings(max_words=2, max_words_bytes=size + len(BOX.data))) as api:
        limits = api.http.get("/v1/limits").json()["words"]
        assert (limits["max_words"], limits["max_words_bytes"]) == (2, size + len(BOX.data))
        assert given(api, FRUIT).status_code == 201
        problem = check_problem(given(api, BOX, WEDGE), 422, "parameter_invalid")
        assert problem["limit"] == 2
        problem = check_problem(given(api, WEDGE), 422, "parameter_invalid")
        assert problem["limit"] == size + len(BOX.data)
        assert nouns(api) == ["dragon-fruit"]
        assert given(api, BOX).status_code == 201
        for noun in nouns(api):
            api.http.delete(f"/v1/words/{noun}")


def test_owners_have_words_of_their_own(own_settings: Callable[..., Settings]) -> None:
    with serving_api(own_settings(auth="on")) as api:
        keys = {owner: api.record.keys.create(owner)[1] for owner in ("ann", "bob")}
        ann, bob = (httpx.Client(base_url=api.url, headers={"Authorization": f"Bearer {key}"}) for key in keys.values())
        with ann, bob:
            files: Any = {"word": ("a.word", FRUIT.data), "request": (None, "{}")}
            assert ann.post("/v1/words", files=files).status_code == 201
            assert bob.get("/v1/words").json() == {"words": []}
            for path in ("", "/content", "/picture.png"):
                check_problem(bob.get(f"/v1/words/dragon-fruit{path}"), 404, "not_found")
            check_problem(bob.delete("/v1/words/dragon-fruit"), 404, "not_found")
            job: Any = {"asset": ("a.glb", mesh()), "request": (None, json.dumps({"prompt": "a pitaya"}))}
            check_problem(bob.post("/v1/jobs", files=job), 422, "prompt_unknown_words")
            assert bob.get("/v1/models").json()["shapes"]["nouns"][0] != "dragon-fruit"
            assert bob.post("/v1/words", files={**files, "word": ("a.word", OTHER.data)}).status_code == 201
            assert bob.delete("/v1/words/dragon-fruit").status_code == 204
            made = ann.post("/v1/jobs", files=job)
            assert made.json()["params"]["guidance"]["words"] == {"dragon-fruit": FRUIT.sha256}


def test_content_that_no_word_and_no_job_needs_is_swept(own: Api) -> None:
    left = word("okapi", box(1, 1, 5))
    given(own, FRUIT)
    own.store.put(FILES + left.sha256, left.data)
    own.record.files.unpin([FILES + left.sha256])  # as a process leaves it that dies before it keeps the word

    def swept() -> bool:
        remove_unreachable(own.record, own.store)
        return not own.store.exists(FILES + left.sha256)

    until(swept, "what nothing needs is gone")
    assert own.store.exists(FILES + FRUIT.sha256)
