"""Requests with an `Idempotency-Key` are done once, also when they come twice at the same time."""

from __future__ import annotations

import json
import uuid
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx

from tests.cases import each_case
from tests.integration.conftest import Api
from tests.integration.http_calls import PROMPT, check_problem
from tests.integration.test_api_continuing import interrupted_job


def key() -> dict[str, str]:
    return {"Idempotency-Key": uuid.uuid4().hex}


def create(api: Api, sphere: bytes, headers: dict[str, str], **more: Any) -> httpx.Response:
    files = {"asset": ("s.glb", sphere), "request": (None, json.dumps({**PROMPT, **more}))}
    return api.http.post("/v1/jobs", files=files, headers=headers)


def count(api: Api) -> int:
    return len(api.record.list_jobs(limit=200).jobs)


def test_the_same_request_gets_the_same_answer(api: Api, sphere: bytes) -> None:
    headers, before = key(), count(api)
    first = create(api, sphere, headers)
    assert first.status_code == 202, first.text
    assert "idempotency-replayed" not in first.headers
    api.record.request_cancel(first.json()["id"])
    again = create(api, sphere, headers)
    assert (again.status_code, again.json()) == (202, first.json())
    assert again.headers["idempotency-replayed"] == "true"
    for name in ("location", "etag", "retry-after"):
        assert again.headers[name] == first.headers[name]
    assert count(api) == before + 1


def test_another_request_with_the_key_is_refused(api: Api, sphere: bytes, repository: Any) -> None:
    headers = key()
    # One that was refused gives its key free.
    check_problem(create(api, sphere[:-4], headers), 422, "asset_truncated")
    assert create(api, sphere, headers).status_code == 202
    check_problem(create(api, sphere, headers, prompt="a vase"), 422, "idempotency_mismatch")
    cube = (repository / "examples" / "cube.glb").read_bytes()
    check_problem(create(api, cube, headers), 422, "idempotency_mismatch")
    upload = {"filename": "a.glb", "size": 3}
    check_problem(api.http.post("/v1/uploads", json=upload, headers=headers), 422, "idempotency_mismatch")


@each_case("text", ["", "x" * 256, "with space", "a\tb", "ümlaut"])
def test_a_key_that_is_none_is_refused(api: Api, sphere: bytes, text: str) -> None:
    problem = check_problem(create(api, sphere, {"Idempotency-Key": text.encode()}), 422, "parameter_invalid")  # type: ignore[dict-item]
    assert problem["errors"][0]["loc"] == ["header", "idempotency-key"]


@each_case("what", ["create", "retry", "branch", "upload"])
def test_many_at_once_do_it_once(api: Api, sphere: bytes, what: str) -> None:
    headers, source = key(), interrupted_job(api, steps=(5,))
    before = count(api)
    calls = {
        "create": lambda: create(api, sphere, headers),
        "retry": lambda: api.http.post(f"/v1/jobs/{source}/retry", headers=headers),
        "branch": lambda: api.http.post(f"/v1/jobs/{source}/checkpoints/5/branch", json=PROMPT, headers=headers),
        "upload": lambda: api.http.post("/v1/uploads", json={"filename": "a", "size": 3}, headers=headers),
    }
    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(lambda _: calls[what](), range(6)))
    answers.append(calls[what]())
    done = [answer for answer in answers if answer.status_code in (201, 202)]
    assert {answer.status_code for answer in answers} <= {201, 202, 409}
    assert len({answer.json()["id"] for answer in done}) == 1
    assert len([answer for answer in done if "idempotency-replayed" not in answer.headers]) == 1
    assert answers[-1].headers["idempotency-replayed"] == "true"
    assert count(api) == before + (what != "upload")
