"""Fill the disk with uploads: an owner may have only so many, and so large, that no job has used."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from meshdeform.errors import TooManyUploadsError
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from service.http.auth import principal
from tests.integration.conftest import serving_app
from tests.integration.http_calls import PROMPT, check_problem
from tests.integration.test_api_owners import named


@pytest.fixture
def url(own_settings: Callable[..., Settings]) -> Iterator[str]:
    """A server that allows each owner three uploads of 200,000 bytes altogether."""
    with serving_app(own_settings(max_uploads=3, max_uploads_bytes=200_000)) as (url, app):
        app.dependency_overrides[principal] = named
        yield url


def test_uploads_are_limited_in_number_and_bytes(url: str, sphere: bytes) -> None:
    def begin(size: int, who: str = "ann") -> httpx.Response:
        document = {"filename": "a.glb", "size": size}
        return httpx.post(f"{url}/v1/uploads", json=document, headers={"x-owner": who})

    headers = {"x-owner": "ann"}
    limits = httpx.get(f"{url}/v1/limits", headers=headers).json()["uploads"]
    assert (limits["max_uploads"], limits["max_uploads_bytes"]) == (3, 200_000)

    first: dict[str, Any] = begin(len(sphere)).json()
    problem = check_problem(begin(200_000), 429, "too_many_uploads")
    assert (problem["limit"], problem["stored"]) == (200_000, len(sphere))
    assert begin(1).status_code == begin(1).status_code == 201
    assert check_problem(begin(1), 429, "too_many_uploads")["limit"] == 3
    assert begin(1, "bob").status_code == 201, "another owner's count for nothing"

    # What a job uses is the job's.
    assert httpx.put(f"{url}{first['url']}", content=sphere).status_code == 204
    path = f"{url}/v1/uploads/{first['id']}/complete"
    digest = hashlib.sha256(sphere).hexdigest()
    assert httpx.post(path, json={"sha256": digest}, headers=headers).status_code == 200
    assert begin(1).status_code == 429
    job = {**PROMPT, "asset": {"upload_id": first["id"]}}
    assert httpx.post(f"{url}/v1/jobs", json=job, headers=headers, timeout=240).status_code == 202
    assert begin(200_000 - 2).status_code == 201


@pytest.mark.both_databases
def test_uploads_that_come_at_once_are_counted_one_after_the_other(record: JobRecord) -> None:
    def create(_: int) -> bool:
        try:
            record.uploads.create("ann", "a.glb", 1, 60.0, max_uploads=3)
        except TooManyUploadsError:
            return False
        return True

    with ThreadPoolExecutor(6) as pool:
        assert sum(pool.map(create, range(12))) == 3
