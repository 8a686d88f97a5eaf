"""A link to a job shows that job to whoever has it, and opens nothing besides."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from meshdeform.client import Client
from meshdeform.errors import UnauthorizedError
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import sign_path
from service.http.links import SIGNING_KEY
from tests.cases import each_case
from tests.integration.conftest import Api, serving_api
from tests.integration.http_calls import check_problem, finished_job, kept

CONTENT = b"glTF" + bytes(range(200))
REQUEST: dict[str, Any] = {"prompt": "x", "metadata": {"customer": "secret"}}


def owned_job(api: Api) -> str:
    """A job of an owner that has succeeded, with an asset, a target and a result."""
    file = kept(api, b"asset", "a.glb")
    return finished_job(api, CONTENT, "mine", files={"asset": file, "target": file}, **REQUEST)


class Shared:
    """Two jobs of an owner with a key, and a link to the first."""

    def __init__(self, api: Api) -> None:
        self.api, (made, text) = api, api.record.keys.create("mine")
        self.key_id, self.key = made.id, {"Authorization": f"Bearer {text}"}
        self.job, self.other = owned_job(api), owned_job(api)
        self.answer = api.http.post(f"/v1/jobs/{self.job}/url", headers=self.key)
        self.token = self.answer.json()["url"].rpartition("/")[2]
        self.link = {"Authorization": f"Bearer {self.token}"}

    def get(self, path: str, **headers: str) -> httpx.Response:
        return self.api.http.get(f"/v1/jobs/{path}", headers={**self.link, **headers})


@pytest.fixture
def shared(record: JobRecord, own_settings: Callable[..., Settings]) -> Iterator[Shared]:
    with serving_api(own_settings(auth="on")) as api:
        yield Shared(api)


def test_a_link_shows_one_job_with_its_asset_and_results(shared: Shared, caplog: pytest.LogCaptureFixture) -> None:
    assert shared.answer.status_code == 200
    assert shared.answer.headers["cache-control"] == "no-store"
    made = shared.answer.json()
    # Behind the #, which browsers send to no server, neither as an address nor as a Referer.
    assert made["url"] == f"/#/shared/{shared.job}/{shared.token}"
    assert shared.token not in made["url"].partition("#")[0]
    lifetime = datetime.fromisoformat(made["expires_at"]) - datetime.now(UTC)
    assert timedelta(seconds=3500) < lifetime <= timedelta(seconds=3600)

    with caplog.at_level(logging.DEBUG):
        found = shared.get(shared.job)
        assert (found.status_code, found.headers["cache-control"]) == (200, "no-store")
        assert (found.json()["prompt"], found.json()["state"]) == ("x", "succeeded")
        assert (found.json()["metadata"], found.json()["origin"]) == ({}, None)
        artifact = shared.get(f"{shared.job}/artifacts/result.glb")
        assert (artifact.status_code, artifact.content) == (200, CONTENT)
        assert "access-control-allow-origin" not in artifact.headers
        assert shared.get(f"{shared.job}/artifacts/result.glb", Range="bytes=4-9").content == CONTENT[4:10]
        assert shared.get(f"{shared.job}/asset").content == b"asset"
        assert [each["name"] for each in shared.get(f"{shared.job}/artifacts").json()["artifacts"]] == ["result.glb"]
        assert shared.get(f"{shared.job}/checkpoints").json() == {"checkpoints": []}
        events = shared.get(f"{shared.job}/events").json()["events"]
        assert events[-1]["type"] == "succeeded"
        stream = shared.get(f"{shared.job}/events", Accept="text/event-stream")
        assert "event: succeeded" in stream.text
    assert not [line for line in caplog.messages if shared.token.rpartition(".")[2] in line]
    with Client(shared.api.url, api_key=shared.token) as client:
        assert client.get(shared.job).prompt == "x"


READS = ("", "/asset", "/artifacts", "/artifacts/result.glb", "/events", "/checkpoints")


def test_it_opens_no_other_job_no_other_file_and_changes_nothing(shared: Shared) -> None:
    http, job = shared.api.http, shared.job
    for rest in READS:
        check_problem(shared.get(f"{shared.other}{rest}"), 401, "unauthorized")
        assert http.get(f"/v1/jobs/{shared.other}{rest}", headers=shared.key).status_code == 200
    for rest in ("/files/asset", "/files/target"):
        check_problem(shared.get(f"{job}{rest}"), 401, "unauthorized")
    check_problem(shared.get(f"{job}/artifacts/result.glb?strength=0.5"), 403, "forbidden")
    for method, path in (
        ("DELETE", f"/v1/jobs/{job}"),
        ("POST", f"/v1/jobs/{job}/cancel"),
        ("POST", f"/v1/jobs/{job}/retry"),
        ("POST", f"/v1/jobs/{job}/url"),
        ("POST", f"/v1/jobs/{job}/artifacts/result.stl"),
        ("POST", f"/v1/jobs/{job}/artifacts/result.glb/url"),
        ("POST", f"/v1/jobs/{job}/checkpoints/0/branch"),
        ("POST", "/v1/jobs"),
        ("POST", "/v1/uploads"),
        ("POST", "/v1/webhooks"),
        ("GET", "/v1/jobs"),
        ("GET", "/v1/webhooks"),
        ("GET", "/v1/limits"),
        ("GET", "/v1/models"),
        ("GET", "/metrics"),
        ("GET", "/v1/jobs?nonsense=1"),
    ):
        answer = http.request(method, path, headers=shared.link, json={} if method == "POST" else None)
        assert (answer.status_code, answer.json()["code"]) == (401, "unauthorized"), path
    assert {each.id for each in shared.api.record.list_jobs(owner="mine").jobs} == {job, shared.other}
    # And it is no signed URL, nor a signed URL a link.
    _, expires, key_id, signature = shared.token.split(".")
    path = f"/v1/jobs/{job}/artifacts/result.glb"
    for at in (path, f"/v1/jobs/{job}", f"/v1/jobs/{job}/"):
        assert http.get(f"{at}?key={key_id}&expires={expires}&signature={signature}").status_code in (401, 403, 404)
    signed = http.post(f"{path}/url", headers=shared.key).json()["url"]
    until, sealed = (part.partition("=")[2] for part in signed.partition("?")[2].split("&"))
    forged = {"Authorization": f"Bearer link.{until}..{sealed}"}
    check_problem(http.get(f"/v1/jobs/{job}", headers=forged), 401, "unauthorized")


@each_case(
    "change",
    [
        lambda token: token[:-1] + ("0" if token[-1] != "0" else "1"),
        lambda token: token.replace("link.", "link.9", 1),
        lambda token: ".".join([*token.split(".")[:2], "", token.split(".")[3]]),
        lambda token: token.rpartition(".")[0],
        lambda token: f"{token}.x",
        lambda _: "link.",
        lambda _: "link....",
        lambda _: "link.99999999999999999999999..00",
        lambda _: "link.x&expires=9..00&signature=0",
    ],
    ids=["signature", "expiry", "key", "none", "more", "nothing", "dots", "late", "parameters"],
)
def test_what_was_changed_is_refused(change: Any, shared: Shared) -> None:
    for rest in READS:
        answer = shared.api.http.get(
            f"/v1/jobs/{shared.job}{rest}", headers={"Authorization": f"Bearer {change(shared.token)}"}
        )
        problem = check_problem(answer, 401, "unauthorized")
        assert problem["detail"] == "The link does not open this job."


def test_it_ends_with_its_time_its_key_and_its_job(shared: Shared) -> None:
    path, secret = f"/v1/jobs/{shared.job}/", shared.api.record.secret(SIGNING_KEY)

    def status(seconds: int) -> tuple[int, str]:
        until = int(time.time()) + seconds
        signature = sign_path("GET", path, until, secret, {"key": shared.key_id}).rpartition("=")[2]
        token = f"link.{until}.{shared.key_id}.{signature}"
        answer = shared.api.http.get(path[:-1], headers={"Authorization": f"Bearer {token}"})
        return answer.status_code, answer.json().get("detail", "")

    assert status(60) == (200, "")
    assert status(0) == (401, "The link has expired.")
    shared.api.record.keys.revoke(shared.key_id)
    assert status(60) == (401, "The link was withdrawn: the API key that made it was revoked.")
    with Client(shared.api.url, api_key=shared.token) as client, pytest.raises(UnauthorizedError, match="withdrawn"):
        client.get(shared.job)


def test_only_the_owner_makes_links(shared: Shared) -> None:
    stranger = {"Authorization": f"Bearer {shared.api.record.keys.create('other')[1]}"}
    path = f"/v1/jobs/{shared.job}/url"
    check_problem(shared.api.http.post(path, headers=stranger), 404, "not_found")
    check_problem(shared.api.http.post(path), 401, "unauthorized")
    with Client(shared.api.url, api_key=shared.key["Authorization"].removeprefix("Bearer ")) as client:
        assert client.job_link(shared.job).url.startswith(f"{shared.api.url}/#/shared/{shared.job}/link.")
    shared.api.record.delete(shared.job)
    check_problem(shared.get(shared.job), 404, "not_found")
    check_problem(shared.api.http.post(path, headers=shared.key), 404, "not_found")


def test_a_deployment_without_the_page_makes_none(own_settings: Callable[..., Settings]) -> None:
    with serving_api(own_settings(auth="on", web="off")) as api:
        key = {"Authorization": f"Bearer {api.record.keys.create('mine')[1]}"}
        problem = check_problem(api.http.post(f"/v1/jobs/{owned_job(api)}/url", headers=key), 404, "not_found")
        assert "no page" in problem["detail"]
