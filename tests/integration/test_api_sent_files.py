"""The files of a job come back as they were sent."""

from __future__ import annotations

import hashlib
import io
import zipfile
from email.message import Message
from pathlib import Path

import httpx

from meshdeform.record.models import JobState
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem, post


def filename(answer: httpx.Response) -> str | None:
    """What a client that knows RFC 8187 calls it."""
    message = Message()
    message["Content-Disposition"] = answer.headers["content-disposition"]
    return message.get_filename()


def posted(api: Api, content: bytes, name: str = "sphere.glb") -> str:
    answer = post(api, content, filename=name)
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def test_an_asset_comes_back_in_any_state(api: Api, sphere: bytes) -> None:
    job_id = posted(api, sphere)
    url, tag = f"/v1/jobs/{job_id}/asset", f'"{hashlib.sha256(sphere).hexdigest()}"'
    queued = api.http.get(url)
    assert (queued.status_code, queued.content) == (200, sphere)
    assert queued.headers["content-type"] == "model/gltf-binary"
    assert (queued.headers["etag"], queued.headers["accept-ranges"]) == (tag, "bytes")
    assert queued.headers["x-content-type-options"] == "nosniff"
    assert claim_job(api.record.leases, job_id, "worker", 60.0)
    assert api.http.get(url).content == sphere
    api.record.leases.finish(job_id, 1, JobState.SUCCEEDED, results=[])
    assert api.http.get(url).content == sphere
    part = api.http.get(url, headers={"Range": "bytes=4-19", "If-Range": tag})
    assert (part.status_code, part.content) == (206, sphere[4:20])
    assert api.http.get(url, headers={"If-None-Match": tag}).status_code == 304
    head = api.http.head(url)
    assert (head.status_code, head.content, head.headers["content-length"]) == (200, b"", str(len(sphere)))
    check_problem(api.http.get(url, headers={"Range": f"bytes={len(sphere)}-"}), 416, "range_not_satisfiable")


def test_a_target_comes_back_and_a_job_without_one_says_so(api: Api, sphere: bytes, repository: Path) -> None:
    cube = (repository / "examples" / "cube.glb").read_bytes()
    answer = post(api, sphere, {"params": {"guidance": {"kind": "target"}}}, target=("cube.glb", cube))
    assert answer.status_code == 202, answer.text
    job_id = answer.json()["id"]
    found = api.http.get(f"/v1/jobs/{job_id}/files/target")
    assert (found.status_code, found.content, filename(found)) == (200, cube, "cube.glb")
    assert api.http.get(f"/v1/jobs/{job_id}/asset").content == sphere
    for method in ("GET", "HEAD"):
        assert api.http.request(method, f"/v1/jobs/{posted(api, sphere)}/files/target").status_code == 404
    problem = check_problem(api.http.get(f"/v1/jobs/{posted(api, sphere)}/files/target"), 404, "not_found")
    assert (problem["advice"], problem["files"]) == ("It has: asset.", ["asset"])
    for part, content in {"asset": sphere, "target": cube}.items():
        assert api.http.get(f"/v1/jobs/{job_id}/files/{part}").content == content


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def _zip(name: str, content: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(name, content)
    return packed.getvalue()


ZIP = _zip("triangle.obj", OBJ)


@each_case(
    ("name", "content", "expected"),
    [
        ("triangle.OBJ", OBJ, "model/obj"),
        ("triangle.zip", ZIP, "application/zip"),
        ("sphere", None, "model/gltf-binary"),
        ("page.html", None, "model/gltf-binary"),
    ],
)
def test_the_type_is_that_of_the_content(
    api: Api, sphere: bytes, name: str, content: bytes | None, expected: str
) -> None:
    sent = sphere if content is None else content
    found = api.http.get(f"/v1/jobs/{posted(api, sent, name)}/asset")
    assert (found.status_code, found.content, found.headers["content-type"]) == (200, sent, expected)
    assert (filename(found), found.headers["content-disposition"]) == (name, f'attachment; filename="{name}"')


@each_case(
    ("sent", "plain"),
    [
        ("Müller's Vase №1.glb", "M_ller's Vase _1.glb"),
        ('a"; filename="b.glb', "a_; filename=_b.glb"),
        ("100%41.glb", "100_41.glb"),
        ("花瓶.glb", "__.glb"),
    ],
)
def test_a_name_cannot_leave_its_header(api: Api, sphere: bytes, sent: str, plain: str) -> None:
    # httpx quotes names as HTML forms do, so that they arrive as they are here.
    job_id = posted(api, sphere, sent)
    name = api.record.get(job_id).files["asset"].filename
    header = api.http.get(f"/v1/jobs/{job_id}/asset").headers["content-disposition"]
    assert header.isascii()
    first, _, full = header.partition("; filename*=UTF-8''")
    message = Message()
    message["Content-Disposition"] = f"attachment; filename*=UTF-8''{full}"
    assert message.get_filename() == name
    if name == sent:
        assert first == f'attachment; filename="{plain}"'
    assert first.count('"') == 2
