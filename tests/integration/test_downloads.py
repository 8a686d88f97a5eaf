"""Who may read an artifact: its owner, and for a while whoever has a signed URL. On a folder and on a real S3."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from tests.integration.conftest import DEADLINE_S, Api, serving_api
from tests.integration.http_calls import check_document, check_problem, finished_job

CONTENT = bytes(range(256)) * 64


@pytest.fixture
def closed(record: JobRecord, own_settings: Callable[..., Settings]) -> Iterator[Api]:
    """A server that wants keys, on a folder."""
    with serving_api(own_settings(auth="on")) as api:
        yield api


def owner(api: Api, name: str) -> tuple[str, dict[str, str]]:
    """A new owner, and the header of its key."""
    key, text = api.record.keys.create(name)
    return key.owner_id, {"Authorization": f"Bearer {text}"}


def test_a_signed_url_needs_no_key_and_opens_one_thing(closed: Api, openapi: dict[str, Any]) -> None:
    mine, key = owner(closed, "mine")
    job_id, another = finished_job(closed, owner_id=mine), finished_job(closed, owner_id=mine)
    path = f"/v1/jobs/{job_id}/artifacts/result.glb"
    answer = closed.http.post(f"{path}/url", headers=key)
    assert answer.status_code == 200, answer.text
    assert answer.headers["cache-control"] == "no-store"
    signed = answer.json()
    check_document(signed, "SignedUrl", openapi)
    lifetime = datetime.fromisoformat(signed["expires_at"]) - datetime.now(UTC)
    assert timedelta(seconds=3500) < lifetime <= timedelta(seconds=3600)
    url = signed["url"]
    whole = closed.http.get(url)
    assert (whole.status_code, whole.content) == (200, CONTENT)
    assert whole.headers["access-control-allow-origin"] == "*"
    assert "access-control-allow-origin" not in closed.http.get(path, headers=key).headers
    part = closed.http.get(url, headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, CONTENT[10:20])
    assert closed.http.head(url).headers["content-length"] == str(len(CONTENT))
    assert closed.http.get(url, headers={"If-None-Match": whole.headers["etag"]}).status_code == 304
    query = url.partition("?")[2]
    last = url[-1]
    for touched in (
        url[:-1] + ("0" if last != "0" else "1"),
        f"{path}?{query.partition('&')[0]}",
        f"{path}?expires=99999999999999999999999&signature=é",
        f"/v1/jobs/{another}/artifacts/result.glb?{query}",
    ):
        check_problem(closed.http.get(touched), 403, "forbidden")
        # A key does not mend it: what the URL says is what counts.
        check_problem(closed.http.get(touched, headers=key), 403, "forbidden")
    for other in (f"/v1/jobs/{job_id}/artifacts?{query}", f"/v1/jobs/{job_id}?{query}", f"{path}/url?{query}"):
        check_problem(closed.http.request("POST" if "/url" in other else "GET", other), 401, "unauthorized")
    closed.record.delete(job_id)
    check_problem(closed.http.get(url), 404, "not_found")


def test_of_a_bucket_the_url_is_its_own(own_settings: Callable[..., Settings], s3_store_url: str) -> None:
    with serving_api(own_settings(auth="on", storage_url=s3_store_url)) as api:
        mine, key = owner(api, "mine")
        path = f"/v1/jobs/{finished_job(api, owner_id=mine)}/artifacts/result.glb"
        url = api.http.post(f"{path}/url", headers=key).json()["url"]
        assert not url.startswith(("/", api.url))
        answer = httpx.get(url, timeout=DEADLINE_S)
        assert (answer.status_code, answer.content) == (200, CONTENT)
        assert answer.headers["content-type"] == "model/gltf-binary"
        assert answer.headers["content-disposition"] == 'attachment; filename="result.glb"'
        assert httpx.get(url[:-1] + ("0" if url[-1] != "0" else "1"), timeout=DEADLINE_S).status_code == 403
        assert api.http.get(path, headers=key).content == CONTENT
