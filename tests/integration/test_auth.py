"""Who may ask, how often, and what every answer carries: over real sockets, with real databases and a real Redis."""

from __future__ import annotations

import json
import uuid
from pathlib import Path

import httpx
import pytest

from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from service.http.auth import _FAILURES
from service.http.limits import RateLimiter
from tests.integration.conftest import Start, new_job

OPEN = ("/healthz", "/readyz", "/openapi.json")
CLOSED = ("/v1/jobs", "/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6", "/metrics")


def bearer(text: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {text}"}


def check_refused(answer: httpx.Response) -> None:
    assert answer.status_code == 401, answer.text
    assert answer.json()["code"] == "unauthorized"
    assert answer.headers["www-authenticate"] == "Bearer"


def test_where_keys_are_on_nothing_but_health_and_description_is_had_without_one(
    start: Start, record: JobRecord
) -> None:
    http = start(auth="on")
    for path in OPEN:
        assert http.get(path).status_code == 200, path
    for path in CLOSED:
        check_refused(http.get(path))
    check_refused(http.post("/v1/jobs", files={"asset": b"", "request": b"{}"}))
    for _ in range(_FAILURES.burst + 5):  # right keys do not count as guesses
        _, text = record.keys.create("studio")
        assert http.get("/v1/jobs", headers=bearer(text)).status_code == 200
    assert http.get("/v1/jobs", headers={"authorization": f"bearer  {text}"}).status_code == 200
    for sent in (f"Basic {text}", text, "Bearer", f"Bearer {text}x", f"Bearer {text} {text}"):
        check_refused(http.get("/v1/jobs", headers={"Authorization": sent}))
    check_refused(http.get("/v1/jobs", params={"key": text}))
    check_refused(http.get("/v1/jobs", headers={"X-API-Key": text}))


def test_where_keys_are_off_none_is_needed_and_one_that_is_sent_counts(start: Start, record: JobRecord) -> None:
    http = start(auth="off")
    nobodys = new_job(record)
    _, text = record.keys.create("studio")
    assert [job["id"] for job in http.get("/v1/jobs").json()["jobs"]] == [nobodys.id]
    assert http.get("/v1/jobs", headers=bearer(text)).json()["jobs"] == []
    check_refused(http.get("/v1/jobs", headers=bearer(f"{text}x")))
    # A proxy's own business.
    assert http.get("/v1/jobs", headers={"Authorization": "Basic dTpw"}).status_code == 200


def test_auto_asks_for_a_key_wherever_the_connection_is_not_loopback(
    record: JobRecord, database_url: str, redis_url: str, tmp_path: Path
) -> None:
    """The application run by another server: all that it knows is the local end of each connection."""
    import anyio

    from service.app import create_app

    app = create_app(
        Settings(data_dir=tmp_path, database_url=database_url, redis_url=redis_url, queue=f"test-{uuid.uuid4().hex}")
    )

    async def ask() -> dict[str, int]:
        found = {}
        async with app.router.lifespan_context(app):
            for server in ("127.0.0.1", "[::1]", "192.0.2.7", "meshdeform.example"):
                # The peer is on this machine, as a proxy is: that decides nothing.
                transport = httpx.ASGITransport(app=app, client=("127.0.0.1", 50_000))
                async with httpx.AsyncClient(transport=transport, base_url=f"http://{server}") as http:
                    found[server] = (await http.get("/v1/jobs")).status_code
        return found

    assert anyio.run(ask) == {"127.0.0.1": 200, "[::1]": 200, "192.0.2.7": 401, "meshdeform.example": 401}


def test_a_revoked_key_is_refused_once_the_cache_has_forgotten_it(
    start: Start, record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    http = start(auth="on")
    key, text = record.keys.create("studio")
    assert http.get("/v1/jobs", headers=bearer(text)).status_code == 200
    record.keys.revoke(key.id)
    # What remembers is this process: let its 5 seconds be over.
    monkeypatch.setattr("service.http.auth.time.monotonic", lambda: 1e12)
    check_refused(http.get("/v1/jobs", headers=bearer(text)))


def test_a_key_has_a_rate_that_all_processes_count_together(start: Start, record: JobRecord) -> None:
    servers = [start(auth="on"), start(auth="on")]
    _, text = record.keys.create("studio", requests_per_minute=4)
    _, other = record.keys.create("studio", requests_per_minute=0)
    answers = [servers[number % 2].get("/v1/jobs", headers=bearer(text)) for number in range(4)]
    assert [answer.status_code for answer in answers] == [200] * 4
    assert [answer.headers["ratelimit-policy"] for answer in answers] == ['"burst";q=4;w=60'] * 4
    assert [answer.headers["ratelimit"].partition(";t=")[0] for answer in answers] == [
        f'"burst";r={left}' for left in (3, 2, 1, 0)
    ]
    refused = servers[0].get("/v1/jobs", headers=bearer(text))
    assert (refused.status_code, refused.json()["code"]) == (429, "rate_limited")
    assert 1 <= int(refused.headers["retry-after"]) <= 15
    seconds = refused.headers["retry-after"]
    assert refused.json()["retry_after_s"] == int(seconds)
    _, burst = record.keys.create("studio", requests_per_minute=20)
    told = servers[0].get("/v1/jobs", headers=bearer(burst)).headers
    assert (told["ratelimit-policy"], told["ratelimit"]) == ('"burst";q=10;w=30', '"burst";r=9;t=3')
    unlimited = servers[0].get("/v1/jobs", headers=bearer(other))
    assert unlimited.status_code == 200
    assert "ratelimit" not in unlimited.headers


def test_the_settings_rate_holds_where_the_key_says_nothing_and_nobody_without_a_key_is_counted(
    start: Start, record: JobRecord
) -> None:
    http = start(auth="off", requests_per_minute=2)
    _, text = record.keys.create("studio")
    assert [http.get("/v1/jobs", headers=bearer(text)).status_code for _ in range(3)] == [200, 200, 429]
    assert {http.get("/v1/jobs").status_code for _ in range(5)} == {200}


def test_redis_and_the_process_count_alike(redis_url: str) -> None:
    import redis

    limiter = RateLimiter(redis_url, "test")
    for per_minute in (1, 7, 100):
        name = f"key-{per_minute}"
        rates = [limiter.take(name, per_minute) for _ in range(12)]
        burst = min(per_minute, 10)
        assert [bool(verdict.wait_s) for verdict in rates] == [False] * burst + [True] * (12 - burst)
        assert [verdict.remaining for verdict in rates[:burst]] == list(reversed(range(burst)))
    assert limiter._away_until < 0  # it was Redis that said so
    with redis.Redis.from_url(redis_url) as connection:  # which forgets a key that is quiet
        assert all(connection.pttl(name) > 0 for name in connection.keys("test:rate:*"))
    limiter.close()


def test_a_key_may_have_so_many_unfinished_jobs(start: Start, record: JobRecord, repository: Path) -> None:
    http = start(auth="on")
    _, text = record.keys.create("studio", max_active_jobs=1)
    files = {
        "asset": ("sphere.glb", (repository / "examples" / "sphere.glb").read_bytes()),
        "request": (None, json.dumps({"prompt": "a mushroom"})),
    }
    headers = {**bearer(text), "X-Request-ID": "mine-3"}
    answers = [http.post("/v1/jobs", files=files, headers=headers) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [202, 429], answers[-1].text
    assert answers[1].json()["code"] == "too_many_jobs"
    assert int(answers[1].headers["retry-after"]) >= 1
    job = record.get(answers[0].json()["id"])
    assert (job.owner_id, job.request_id) == ("studio", "mine-3")
    assert len(record.list_jobs().jobs) == 1


def test_a_key_sets_priorities_up_to_its_limit(start: Start, record: JobRecord, repository: Path) -> None:
    http = start(auth="on")
    asset = ("sphere.glb", (repository / "examples" / "sphere.glb").read_bytes())
    for limit, accepted, refused in ((None, (0, -100), 1), (7, (7,), 8), (-5, (-5,), 0)):
        _, text = record.keys.create("studio", max_priority=limit)
        for priority in (*accepted, refused):
            document = json.dumps({"prompt": "a mushroom", "priority": priority})
            files = {"asset": asset, "request": (None, document)}
            tried = http.post("/v1/jobs:validate", files=files, headers=bearer(text))
            answer = http.post("/v1/jobs", files=files, headers=bearer(text))
            assert answer.status_code == (422 if priority == refused else 202), answer.text
            assert tried.status_code == (422 if priority == refused else 200), tried.text
        assert tried.json()["errors"] == answer.json()["errors"]
        assert answer.json()["errors"][0]["loc"] == ["priority"]
        assert http.get("/v1/limits", headers=bearer(text)).json()["jobs"]["max_priority"] == accepted[0]
