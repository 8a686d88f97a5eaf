"""Posting jobs over real sockets: what is accepted, and what is refused and leaves nothing."""

from __future__ import annotations

import hashlib
import json
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.errors import UnavailableError
from meshdeform.record.ids import JOB_ID_PATTERN
from meshdeform.record.queue import JobQueue
from meshdeform.settings import Settings
from service.workspace import Workspace
from tests.cases import each_case
from tests.integration.conftest import Api, serving
from tests.integration.http_calls import PROMPT, check_document, check_problem, glb, post


def test_a_posted_job_is_accepted_recorded_stored_and_told(api: Api, sphere: bytes, openapi: dict[str, Any]) -> None:
    request = {"prompt": "a mushroom", "params": {"preset": "preview", "seed": 7}, "metadata": {"shot": "sc010"}}
    answer = post(api, sphere, request, filename="C:\\models\\my sphere.glb")
    assert answer.status_code == 202, answer.text
    job = answer.json()
    check_document(job, "JobView", openapi)
    assert re.fullmatch(JOB_ID_PATTERN, job["id"])
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert int(answer.headers["retry-after"]) >= 1
    assert job["state"] == "queued"
    assert job["params"] == {"preset": "preview", "seed": 7, "guidance": {"kind": "sds"}}
    assert job["metadata"] == {"shot": "sc010"}
    resolved = api.record.get(job["id"]).resolved
    assert resolved is not None
    assert (resolved["preset"], resolved["seed"], resolved["model"]) == ("preview", 7, "builtin")
    digest = hashlib.sha256(sphere).hexdigest()
    assert job["asset"] == {"filename": "my sphere.glb", "size": len(sphere), "sha256": digest}
    assert api.store.get(f"assets/{digest}") == sphere
    assert api.http.get(answer.headers["location"]).json() == job
    queue = JobQueue(api.settings.redis_url, api.settings.queue)
    assert job["id"] in queue.announced()
    queue.close()


@each_case(
    ("params", "targets", "prompt", "kind", "steps"),
    [
        ({"seed": 7}, (), "a giraffe", "exemplar", 20),
        ({"steps": 30}, (), "a giraffe", "sds", 30),
        ({}, ("target",), "", "target", 150),
        ({}, ("target", "target_2"), "", "exemplar", 20),
    ],
)
def test_a_job_names_the_kind_of_guidance_that_its_request_left_open(
    api: Api, sphere: bytes, params: dict[str, Any], targets: tuple[str, ...], prompt: str, kind: str, steps: int
) -> None:
    document = json.dumps({"prompt": prompt, "params": params})
    files: dict[str, Any] = dict.fromkeys(("asset", *targets), ("a.glb", sphere)) | {"request": (None, document)}
    answer = api.http.post("/v1/jobs", files=files)
    assert answer.status_code == 202, answer.text
    assert answer.json()["params"] == {**params, "guidance": {"kind": kind}}
    job = api.record.get(answer.json()["id"])
    assert job.document["params"] == {**params, "guidance": {"kind": kind}}
    assert job.request.params.kind == kind
    assert job.resolved is not None
    assert job.resolved["guidance"] == kind
    checked = api.http.post("/v1/jobs:validate", files=files)
    assert (checked.json()["params"]["guidance"], checked.json()["estimate"]["steps"]) == (kind, steps)


def test_the_request_may_be_a_file_part_and_a_target_may_come_along(api: Api, sphere: bytes) -> None:
    document = ("request.json", json.dumps({"params": {"guidance": {"kind": "target"}}}), "application/json")
    files = {"request": document, "target": ("t.glb", sphere), "asset": ("a.glb", sphere)}
    answer = api.http.post("/v1/jobs", files=files)
    assert answer.status_code == 202, answer.text
    job = api.record.get(answer.json()["id"])
    asset, target = job.files["asset"], job.files["target"]
    assert target.key == asset.key
    assert (asset.filename, target.filename) == ("a.glb", "t.glb")


HUGE = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"componentType": 5126, "count": 200_000_000, "type": "VEC3"}],
}


@each_case(
    ("asset", "status", "code"),
    [
        (b"", 422, "asset_truncated"),
        (b"PK\x03\x04 no mesh at all", 422, "asset_truncated"),
        (glb(HUGE), 413, "asset_too_large"),
    ],
    ids=["empty", "zip", "huge"],
)
def test_a_bad_asset_is_a_clear_problem_and_leaves_nothing(api: Api, asset: bytes, status: int, code: str) -> None:
    before = api.record.list_jobs().jobs
    check_problem(post(api, asset, filename="x.bin" if asset.startswith(b"PK") else "x.glb"), status, code)
    assert api.record.list_jobs().jobs == before
    assert not api.store.exists(f"assets/{hashlib.sha256(asset).hexdigest()}")


@each_case(
    ("request_", "code", "loc"),
    [
        ("{", "request_invalid", None),
        (b"\xff\xfe", "request_invalid", None),
        ("[]", "parameter_invalid", []),
        ({}, "prompt_invalid", None),
        ({"prompt": " \t "}, "prompt_invalid", None),
        ({"prompt": "x" * 1001}, "prompt_invalid", None),
        ({"prompt": "a quixotic zeitgeist"}, "prompt_unknown_words", None),
        ({**PROMPT, "colour": "red"}, "parameter_invalid", ["colour"]),
        ({**PROMPT, "kind": "teleport"}, "parameter_invalid", ["kind"]),
        ({**PROMPT, "params": {"stepz": 3}}, "parameter_invalid", ["params", "stepz"]),
        ({**PROMPT, "params": {"steps": 0}}, "parameter_invalid", ["params", "steps"]),
        ('{"prompt": "a mushroom", "params": {"seed": NaN}}', "parameter_invalid", ["params", "seed"]),
        ({**PROMPT, "params": {"guidance": {"kind": "target"}}}, "parameter_invalid", ["params", "guidance"]),
        ({**PROMPT, "params": {"guidance": {"model": "somebody/elses"}}}, "model_unavailable", None),
        ({**PROMPT, "metadata": {"a": 1}}, "parameter_invalid", ["metadata", "a"]),
        ({**PROMPT, "metadata": {"a": "\0"}}, "parameter_invalid", ["metadata", "a"]),
        ('{"prompt": "\\ud800"}', "request_invalid", None),
        ("[" * 100_000, "request_invalid", None),
        ("1" * 100_000, "request_invalid", None),
    ],
    ids=lambda value: value if isinstance(value, str) and value.isidentifier() else None,
)
def test_a_bad_request_is_a_clear_problem(api: Api, sphere: bytes, request_: Any, code: str, loc: Any) -> None:
    problem = check_problem(post(api, sphere, request_), 422, code)
    if loc is not None:
        assert [error["loc"] for error in problem["errors"]] == [loc]
        assert set(problem["errors"][0]) == {"loc", "msg", "type"}


@each_case(
    ("files", "named"),
    [
        ({"asset": ("a.glb", b"x")}, "request"),
        ({"request": (None, "{}")}, "asset"),
        ({"asset": ("a.glb", b"x"), "request": (None, "{}"), "extra": ("e", b"x")}, "extra"),
        ([("asset", ("a.glb", b"x")), ("asset", ("b.glb", b"x")), ("request", (None, "{}"))], "twice"),
        ({"asset": ("a.glb", b"x"), "request": (None, "x" * 300_000)}, "longer"),
    ],
)
def test_a_form_with_wrong_parts_says_which(api: Api, files: Any, named: str) -> None:
    assert named in check_problem(api.http.post("/v1/jobs", files=files), 422, "request_invalid")["detail"]


@each_case(
    ("content_type", "body"),
    [
        ("text/plain", b"{}"),
        ("application/json", b"{"),
        ("multipart/form-data", b"--x--"),
        ("multipart/form-data; boundary=x", b""),
        ("multipart/form-data; boundary=x", b'--x\r\nContent-Disposition: form-data; name="asset"\r\n\r\nhalf'),
        ("multipart/form-data; boundary=x", b"nothing of the kind"),
        ("multipart/form-data; boundary=x", b"--x\r\nA: " + b"y" * 20_000),
    ],
)
def test_a_body_that_is_no_such_form_is_refused(api: Api, content_type: str, body: bytes) -> None:
    answer = api.http.post("/v1/jobs", content=body, headers={"Content-Type": content_type})
    check_problem(answer, 422, "request_invalid")


@pytest.mark.parametrize("declared", [True, False], ids=["with a length", "chunked"])
def test_a_body_over_the_limit_is_refused_before_it_is_read(api: Api, declared: bool) -> None:
    sent = 0
    head = b'--x\r\nContent-Disposition: form-data; name="asset"; filename="a.glb"\r\n\r\n'
    total = 64 * 2**20

    def body() -> Any:
        nonlocal sent
        yield head
        while sent < total:
            sent += 2**16
            yield bytes(2**16)

    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    if declared:
        headers["Content-Length"] = str(total + len(head))
    with httpx.Client(base_url=api.url, timeout=240) as client:
        problem = check_problem(client.post("/v1/jobs", content=body(), headers=headers), 413, "asset_too_large")
    assert problem["limit"] == api.settings.max_upload_bytes
    assert sent < total


def test_a_part_that_hangs_does_not_hold_up_the_answer_about_it(tmp_path: Path) -> None:
    """It comes before Redis' own deadline of 5 s, which would be another detail."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        settings = Settings(data_dir=tmp_path, redis_url=f"redis://127.0.0.1:{silent.getsockname()[1]}/0")
        with serving(settings) as url:
            for _ in range(2):
                ready = httpx.get(f"{url}/readyz", timeout=240)
                assert (ready.status_code, ready.json()["record"]["status"]) == (503, "ok")
                assert ready.json()["redis"] == {"status": "unavailable", "detail": "It does not answer."}


def test_a_store_that_is_away_refuses_and_leaves_no_job(
    api: Api, sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object, **__: object) -> None:
        raise UnavailableError("The object store does not answer.")

    monkeypatch.setattr("meshdeform.storage.ObjectStore.holds", lambda *_: False)
    monkeypatch.setattr("meshdeform.storage.ObjectStore.put", away)
    before = api.record.list_jobs(limit=1).jobs
    answer = post(api, sphere)
    check_problem(answer, 503, "unavailable")
    assert int(answer.headers["retry-after"]) >= 1
    assert api.record.list_jobs(limit=1).jobs == before


def test_a_full_disk_is_said_and_passes(api: Api, sphere: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Workspace.temporary_folder

    @contextmanager
    def full(workspace: Workspace) -> Iterator[Path]:
        with real(workspace) as folder:
            (folder / "asset").symlink_to("/dev/full")
            yield folder

    monkeypatch.setattr(Workspace, "temporary_folder", full)
    answer = post(api, sphere)
    problem = check_problem(answer, 503, "unavailable")
    assert ("no room" in problem["detail"], "retry-after" in answer.headers) == (True, True)
    monkeypatch.undo()
    assert post(api, sphere).status_code == 202
