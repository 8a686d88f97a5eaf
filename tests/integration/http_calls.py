"""What the tests of the HTTP API send, and how they look at what comes back."""

from __future__ import annotations

import hashlib
import json
import struct
from typing import Any

import httpx
import jsonschema_rs

from meshdeform.record.models import JobState, NewJob, StoredFile
from meshdeform.requests.document import JobRequest
from tests.claims import claim_job
from tests.integration.conftest import Api, stored_file, stored_result

PROMPT = {"prompt": "a mushroom"}


def post(api: Api, asset: bytes, request: Any = PROMPT, filename: str = "sphere.glb", **more: Any) -> httpx.Response:
    """Post a job; a request that is no string is sent as JSON."""
    document = request if isinstance(request, str | bytes) else json.dumps(request)
    files = {"asset": (filename, asset), "request": (None, document), **more}
    return api.http.post("/v1/jobs", files=files)


def check_problem(answer: httpx.Response, status: int, code: str) -> dict[str, Any]:
    """Check that an answer is a problem document, and return it."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert (problem["status"], problem["code"]) == (status, code)
    assert problem["type"] == f"urn:meshdeform:problem:{code}"
    assert problem["instance"] == answer.request.url.path
    for member in ("title", "detail", "advice"):
        assert problem[member]
    return problem


def check_document(document: Any, name: str, openapi: dict[str, Any]) -> None:
    """Check a document against its schema as it is published."""
    schema = {"$ref": f"#/components/schemas/{name}", "components": openapi["components"]}
    jsonschema_rs.Draft202012Validator(schema, validate_formats=True).validate(document)


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def kept(api: Api, content: bytes, filename: str = "sphere.glb") -> StoredFile:
    """A file of a job that is really there."""
    digest = hashlib.sha256(content).hexdigest()
    api.store.put(f"assets/{digest}", content)
    return StoredFile(key=f"assets/{digest}", filename=filename, size=len(content), sha256=digest)


def finished_job(
    api: Api,
    content: bytes = bytes(range(256)) * 64,
    owner_id: str = "",
    *,
    files: dict[str, StoredFile] | None = None,
    more: dict[str, bytes] | None = None,
    checkpoint: int = 0,
    **request: Any,
) -> str:
    """A job that a worker has brought to its end, with a result and more artifacts; at a step its result was stored."""
    asked = JobRequest.model_validate({"prompt": "a mushroom", **request})
    job = api.record.create(NewJob(asked, files or {"asset": stored_file()}, owner_id=owner_id))
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    made = {"result.glb": content, **(more or {})}
    results = [stored_result(api.store, f"jobs/{job.id}/1/{name}", data) for name, data in made.items()]
    if checkpoint:
        api.record.leases.set_checkpoint(job.id, 1, results[0].key, checkpoint, results[0].sha256)
    api.record.leases.finish(job.id, 1, JobState.SUCCEEDED, results=results)
    return job.id
