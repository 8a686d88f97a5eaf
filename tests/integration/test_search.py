"""Jobs are found by words of their prompts, labels and file names, on SQLite and PostgreSQL."""

from __future__ import annotations

import asyncio
import json

import httpx
import pytest
from typer.testing import CliRunner

from meshdeform.api.limits import MAX_SEARCH
from meshdeform.cli.app import app
from meshdeform.client import AsyncClient, Client
from meshdeform.record.models import JobState, NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from tests.cases import each_case
from tests.integration.conftest import Api, stored_file
from tests.integration.http_calls import check_problem
from tests.integration.record_calls import set_to

MADE = {
    "duck": ("a tall vase", "Duck.glb", {"shot": "sc010"}),
    "straße": ("Ein HAUS an der Straße", "cube.obj", {}),
    "signs": (r"100% of_a\b 'x'", "cafe\u0301.glb", {}),  # e and an accent of its own, as macOS writes it
    "other": ("a vase", "other.glb", {"name": "Chair 7"}),
}


@pytest.fixture
def named(record: JobRecord) -> dict[str, str]:
    """The ids of four jobs of one owner; another owner has the first of them too."""
    ids = {}
    for name, (prompt, filename, labels) in MADE.items():
        request = JobRequest(prompt=prompt, metadata=labels)
        files = {"asset": stored_file(filename=filename)}
        ids[record.create(NewJob(request, files, owner_id="me")).id] = name
        record.create(NewJob(request, files, owner_id="you"))
    return ids


@pytest.mark.both_databases
@each_case(
    "words, expected",
    [
        ("vase", ["other", "duck"]),
        ("DUCK  VASE", ["duck"]),
        ("vase\tduck\n", ["duck"]),
        ("sc010 tall", ["duck"]),
        ("chair", ["other"]),
        ("STRASSE haus", ["straße"]),
        ("CAFÉ", ["signs"]),
        ("0%", ["signs"]),
        ("%", ["signs"]),
        ("_", ["signs"]),
        ("a\\b", ["signs"]),
        ("\\", ["signs"]),
        ("'x' of_", ["signs"]),
        ("d_ck", []),
        ("'; DROP TABLE jobs", []),
        ("shot", []),
        ("vase mushroom", []),
        ("  ", ["other", "signs", "straße", "duck"]),
    ],
)
def test_every_word_must_occur_and_every_sign_is_itself(
    words: str, expected: list[str], record: JobRecord, named: dict[str, str]
) -> None:
    assert [named[job.id] for job in record.list_jobs(owner="me", words=words).jobs] == expected


@pytest.mark.both_databases
def test_a_search_goes_with_pages_states_and_labels(record: JobRecord, named: dict[str, str]) -> None:
    first = record.list_jobs(owner="me", words="vase", limit=1)
    second = record.list_jobs(owner="me", words="vase", limit=1, cursor=first.next_cursor)
    assert [named[job.id] for page in (first, second) for job in page.jobs] == ["other", "duck"]
    assert (first.next_cursor is None, second.next_cursor) == (False, None)
    labelled = record.list_jobs(owner="me", words="vase", metadata={"shot": "sc010"}, state=JobState.QUEUED)
    assert [named[job.id] for job in labelled.jobs] == ["duck"]
    assert len(record.list_jobs(words="vase").jobs) == 4
    job = set_to(record, record.list_jobs(owner="me", words="duck").jobs[0], state=JobState.CANCELED)
    record.delete(job.id, "me")
    assert record.list_jobs(owner="me", words="duck").jobs == []


def test_api_clients_and_command_line_search(api: Api) -> None:
    for prompt in ("a tall vase", "a mushroom"):
        api.record.create(NewJob(JobRequest(prompt=prompt), {"asset": stored_file(filename="Duck.glb")}))
    found = [job["prompt"] for job in api.http.get("/v1/jobs", params={"q": "duck VASE"}).json()["jobs"]]
    assert found == ["a tall vase"]
    with Client(api.url) as client:
        assert [job.prompt for job in client.jobs(search="duck", limit=1)] == ["a mushroom", "a tall vase"]
    assert asyncio.run(_prompts(api.url)) == ["a mushroom"]
    listed = CliRunner().invoke(app, ["jobs", "--search", "tall duck", "--json", "--url", api.url])
    assert [job["prompt"] for job in json.loads(listed.stdout)["jobs"]] == ["a tall vase"]
    for words in ("x" * (MAX_SEARCH + 1), "a\0b"):
        check_problem(api.http.get("/v1/jobs", params=httpx.QueryParams(q=words)), 422, "parameter_invalid")


async def _prompts(url: str) -> list[str]:
    async with AsyncClient(url) as client:
        return [job.prompt async for job in client.jobs(search="mushroom")]
