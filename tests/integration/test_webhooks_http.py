"""Webhooks over HTTP: the server sends while the tests look."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import jobs, webhooks
from meshdeform.record.webhooks import TEST_EVENT
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.integration.conftest import DEADLINE_S, serving, stored_file
from tests.unit.webhooks.receiver import Receiver
from tests.waiting import until


@pytest.fixture(scope="module")
def http(own_settings: Callable[..., Settings], database_url: str) -> Iterator[Callable[[str], httpx.Client]]:
    """A server, and a client for each owner."""
    clients: list[httpx.Client] = []
    keys = JobRecord(database_url)

    def client(owner: str) -> httpx.Client:
        headers = {"Authorization": f"Bearer {keys.keys.create(owner)[1]}"}
        clients.append(httpx.Client(base_url=url, headers=headers, timeout=DEADLINE_S))
        return clients[-1]

    with serving(own_settings(webhook_networks=["127.0.0.0/8"])) as url:
        yield client
        for each in clients:
            each.close()
    keys.close()


def post_job(record: JobRecord, owner: str) -> str:
    return record.create(NewJob(JobRequest(prompt="a mushroom"), {"asset": stored_file()}, owner_id=owner)).id


def test_a_webhook_over_http_from_its_making_to_its_end(
    record: JobRecord, http: Callable[[str], httpx.Client], receiver: Receiver
) -> None:
    ann = http("ann")
    made = ann.post("/v1/webhooks", json={"url": receiver.url, "events": ["job.queued"]})
    assert made.status_code == 201
    document = made.json()
    path, secret = made.headers["location"], document.pop("secret")
    assert path == f"/v1/webhooks/{document['id']}"
    assert ann.get(path).json() == document == ann.get("/v1/webhooks").json()["webhooks"][0]
    assert (document["url"], document["events"], document["enabled"]) == (receiver.url, ["job.queued"], True)

    job_id = post_job(record, "ann")
    message = until(lambda: receiver.messages and receiver.messages[0])
    assert message.verified(secret)["data"]["job"]["id"] == job_id
    log = until(lambda: ann.get(f"{path}/deliveries?state=delivered").json()["deliveries"])
    assert (log[0]["id"], log[0]["job_id"], log[0]["attempt_count"]) == (message.id, job_id, 1)
    detail = ann.get(f"{path}/deliveries/{message.id}").json()
    assert detail["payload"] == message.verified(secret)
    assert [(each["number"], each["status"], each["error"]) for each in detail["attempts"]] == [(1, 204, None)]

    rotated = ann.post(f"{path}/rotate").json()
    assert rotated["rotation_ends_at"] is not None
    tested = ann.post(f"{path}/test")
    assert (tested.status_code, tested.json()["type"], tested.json()["job_id"]) == (202, TEST_EVENT, None)
    second = until(lambda: len(receiver.messages) > 1 and receiver.messages[1])
    assert second.verified(secret) == second.verified(rotated["secret"])
    assert second.verified(secret)["type"] == TEST_EVENT

    replayed = ann.post(f"{path}/deliveries/{message.id}/replay")
    assert (replayed.status_code, replayed.json()["message_id"]) == (202, message.id)
    third = until(lambda: len(receiver.messages) > 2 and receiver.messages[2])
    assert (third.id, third.body) == (message.id, message.body)

    off = ann.patch(path, json={"enabled": False}).json()
    assert (off["enabled"], off["disabled_reason"]) == (False, "disabled by its owner")
    refused = ann.post(f"{path}/test")
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    changed = ann.patch(path, json={"enabled": True, "events": [], "url": receiver.url + "/new"}).json()
    assert (changed["enabled"], changed["events"], changed["url"]) == (True, [], receiver.url + "/new")
    assert ann.delete(path).status_code == 204
    assert ann.get(path).status_code == 404


def test_nobody_finds_another_owners_webhook_over_http(record: JobRecord, http: Callable[[str], httpx.Client]) -> None:
    ann, bob = http("ann"), http("bob")
    path = ann.post("/v1/webhooks", json={"url": "http://127.0.0.1:8080/"}).headers["location"]
    post_job(record, "ann")
    (sent,) = ann.get(f"{path}/deliveries").json()["deliveries"]
    one = f"{path}/deliveries/{sent['id']}"
    for method, url in (
        ("GET", path),
        ("PATCH", path),
        ("DELETE", path),
        ("POST", f"{path}/rotate"),
        ("POST", f"{path}/test"),
        ("GET", f"{path}/deliveries"),
        ("GET", one),
        ("POST", f"{one}/replay"),
    ):
        answer = bob.request(method, url, json={} if method == "PATCH" else None)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found"), (method, url)
    assert bob.get("/v1/webhooks").json() == {"webhooks": []}
    own = bob.post("/v1/webhooks", json={"url": "http://127.0.0.1:8080/"}).headers["location"]
    assert bob.get(f"{own}/deliveries/{sent['id']}").status_code == 404
    assert ann.get(path).status_code == 200


@each_case(
    ("body", "code"),
    [
        ({"url": "http://10.0.0.1/"}, "webhook_address"),
        ({"url": "ftp://127.0.0.1/"}, "webhook_address"),
        ({"url": "https://user:secret@127.0.0.1/"}, "webhook_address"),
        ({"url": 5}, "parameter_invalid"),
        ({"url": "http://127.0.0.1:80/", "x": 1}, "parameter_invalid"),
        ({"url": "http://127.0.0.1:80/", "events": ["job.progress"]}, "parameter_invalid"),
    ],
)
def test_what_is_no_webhook_or_may_not_be_called_is_refused(
    body: dict[str, Any], code: str, record: JobRecord, http: Callable[[str], httpx.Client]
) -> None:
    ann = http("ann")
    path = ann.post("/v1/webhooks", json={"url": "http://127.0.0.1:8080/"}).headers["location"]
    for answer in (ann.post("/v1/webhooks", json=body), ann.patch(path, json=body)):
        assert (answer.status_code, answer.json()["code"]) == (422, code)
    assert [found["url"] for found in ann.get("/v1/webhooks").json()["webhooks"]] == ["http://127.0.0.1:8080/"]
    ann.delete(path)


def test_a_job_names_a_webhook_of_its_own(
    record: JobRecord, http: Callable[[str], httpx.Client], receiver: Receiver, sphere: bytes
) -> None:
    ann, bob = http("ann"), http("bob")
    webhook = {"url": receiver.url, "events": ["job.queued", "job.canceled"]}

    def posted(url: str) -> httpx.Response:
        document = {"prompt": "a mushroom", "webhook": webhook | {"url": url}}
        files = {"asset": ("sphere.glb", sphere), "request": ("request.json", json.dumps(document), "application/json")}
        return ann.post("/v1/jobs", files=files)

    refused = posted("http://10.0.0.1/")
    assert (refused.status_code, refused.json()["code"]) == (422, "webhook_address")
    assert refused.json()["errors"][0]["loc"] == ["webhook", "url"]
    job = posted(receiver.url).json()["id"]
    other = post_job(record, "ann")
    assert ann.post(f"/v1/jobs/{job}/cancel").json()["state"] == "canceled"
    record.request_cancel(other)
    until(lambda: len(receiver.messages) == 2)
    secret = ann.get("/v1/webhooks/secret").json()["secret"]
    assert secret != bob.get("/v1/webhooks/secret").json()["secret"]
    messages = [message.verified(secret) for message in receiver.messages]
    # Two senders may overtake each other.
    told = sorted((each["type"], each["data"]["job"]["id"]) for each in messages)
    assert told == [("job.canceled", job), ("job.queued", job)]
    # It is none of the account's, and goes with its job, by whatever way that goes.
    kept = posted(receiver.url).json()["id"]
    record.request_cancel(kept)
    with record.database.write() as connection:
        connection.execute(sa.update(jobs).where(jobs.c.id == kept).values(retain_until=record.database.now(-1.0)))
    assert record.upkeep.delete_retained() == [kept]
    assert ann.get("/v1/webhooks").json()["webhooks"] == []
    assert ann.delete(f"/v1/jobs/{job}").status_code == 204
    with record.database.read() as connection:
        assert connection.scalar(sa.select(sa.func.count()).where(webhooks.c.job_id.in_([job, kept]))) == 0
