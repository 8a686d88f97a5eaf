"""API keys on the record."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime, timedelta

import pytest
import sqlalchemy as sa
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.cli.servers import _decided, _require_key
from meshdeform.errors import NotFoundError, ParameterError, UnauthorizedError
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import api_keys
from meshdeform.settings import Settings
from tests.cases import each_case


@pytest.mark.both_databases
def test_a_key_is_known_by_its_text_alone(record: JobRecord) -> None:
    key, text = record.keys.create("studio", "ci", requests_per_minute=5, max_active_jobs=2)
    other, other_text = record.keys.create("studio")
    assert re.fullmatch(r"mdk_[0-9a-z]{26}\.[A-Za-z0-9_-]{43}", text)
    assert text.startswith(f"{key.id}.")
    found = record.keys.verify(text)
    assert (found.id, found.owner_id, found.name) == (key.id, "studio", "ci")
    assert (found.requests_per_minute, found.max_active_jobs) == (5, 2)
    assert record.keys.verify(other_text).id == other.id
    assert (other.requests_per_minute, other.max_active_jobs) == (None, None)


def test_no_secret_is_on_the_record(record: JobRecord) -> None:
    _, text = record.keys.create("studio")
    with record.database.read() as connection:
        row = connection.execute(sa.select(api_keys)).one()
    assert text.partition(".")[2] not in " ".join(map(str, row))


def test_whatever_is_wrong_is_the_same_error(record: JobRecord) -> None:
    key, text = record.keys.create("studio")
    another, _ = record.keys.create("studio")
    secret = text.partition(".")[2]
    revoked, revoked_text = record.keys.create("studio")
    record.keys.revoke(revoked.id)
    wrong = {
        "another secret": f"{key.id}.{secret[:-1]}{'A' if secret[-1] != 'A' else 'Q'}",
        "another key's secret": f"{another.id}.{secret}",
        "unknown": f"mdk_{'0' * 26}.{secret}",
        "revoked": revoked_text,
        "no secret": key.id,
        "empty": "",
        "more": f"{text}x",
        "a line's end": f"{text}\n",
        "a long one": "x" * 10_000,
        "not ASCII": "schlüssel",
        "NUL": f"{key.id}\0.{secret}",
    }
    said = set()
    for name, given in wrong.items():
        with pytest.raises(UnauthorizedError) as caught:
            record.keys.verify(given)
        said.add((name if not caught.value.detail else "", caught.value.detail, caught.value.advice_text))
    assert len(said) == 1
    assert record.keys.verify(text).id == key.id


@pytest.mark.both_databases
def test_a_use_is_noted_once_a_minute(record: JobRecord) -> None:
    key, text = record.keys.create("studio")
    assert key.last_used_at is None
    record.keys.verify(text)
    (used,) = record.keys.list()
    assert used.last_used_at is not None
    assert abs(datetime.now(UTC) - used.last_used_at) < timedelta(minutes=1)
    record.keys.verify(text)
    assert record.keys.list() == [used]
    earlier = datetime.now(UTC) - timedelta(minutes=2)
    with record.database.write() as connection:
        connection.execute(sa.update(api_keys).values(last_used_at=earlier))
    record.keys.verify(text)
    assert record.keys.list()[0].last_used_at > earlier  # type: ignore[operator]


def test_revoked_is_revoked_and_stays_on_the_list(record: JobRecord) -> None:
    first, _ = record.keys.create("studio")
    second, _ = record.keys.create("garage")
    assert record.keys.any_active()
    once = record.keys.revoke(first.id)
    assert once.revoked_at is not None
    assert record.keys.revoke(first.id) == once
    assert record.keys.any_active()
    record.keys.revoke(second.id)
    assert not record.keys.any_active()
    assert [key.id for key in record.keys.list()] == [first.id, second.id]
    assert [key.id for key in record.keys.list(owner="garage")] == [second.id]
    with pytest.raises(NotFoundError, match="mdk_nothing"):
        record.keys.revoke("mdk_nothing")


@each_case("owner", ["", "Studio", "-a", "_a", "a b", "a" * 64, "ä", "a\n", "a/b"])
def test_an_owner_that_could_be_mistaken_is_refused(record: JobRecord, owner: str) -> None:
    with pytest.raises(ParameterError, match="cannot be an owner"):
        record.keys.create(owner)
    assert record.keys.list() == []


def test_limits_and_names_have_bounds(record: JobRecord) -> None:
    with pytest.raises(ParameterError, match="-1 cannot be a limit"):
        record.keys.create("studio", requests_per_minute=-1)
    with pytest.raises(ParameterError, match="cannot be a limit"):
        record.keys.create("studio", max_active_jobs=2**40)
    with pytest.raises(ParameterError, match="too long"):
        record.keys.create("studio", "n" * 101)
    assert record.keys.list() == []


def test_the_commands_work_on_the_record_that_the_settings_name(
    record: JobRecord, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHDEFORM_DATABASE_URL", database_url)
    run = CliRunner().invoke
    made = run(app, ["keys", "create", "--owner", "studio", "--name", "ci", "--requests-per-minute", "9", "--json"])
    assert made.exit_code == 0, made.output
    document = json.loads(made.stdout)
    assert record.keys.verify(document["key"]).requests_per_minute == 9
    plain = run(app, ["keys", "create", "--owner", "studio", "--max-active-jobs", "0"])
    assert record.keys.verify(plain.stdout.strip()).max_active_jobs == 0
    assert "only this once" in plain.stderr
    listed = json.loads(run(app, ["keys", "list", "--json"]).stdout)
    assert [key["id"] for key in listed] == [document["id"], plain.stdout.partition(".")[0]]
    assert "key" not in listed[0]
    assert run(app, ["keys", "revoke", document["id"]]).exit_code == 0
    with pytest.raises(UnauthorizedError):
        record.keys.verify(document["key"])
    text = run(app, ["keys", "list"]).stdout
    assert re.search(rf"{document['id']}  studio  revoked  last used .* UTC  ci\n", text)
    assert document["key"].partition(".")[2] not in text
    assert run(app, ["keys", "revoke", "mdk_nothing"]).exit_code == 3
    assert run(app, ["keys", "create", "--owner", "Not This"]).exit_code == 3


@pytest.mark.parametrize("host", ["0.0.0.0", "meshdeform.example"])
def test_who_listens_where_others_are_asks_everybody_for_a_key(record: JobRecord, database_url: str, host: str) -> None:
    settings = Settings(database_url=database_url)
    with pytest.raises(ParameterError, match="none exists") as caught:
        _require_key(settings, host, None)
    assert "meshdeform keys create --owner me. " in caught.value.advice_text
    record.keys.create("studio")
    _require_key(settings, host, None)
    # Not `auto` any more: a connection over loopback would need none.
    assert _decided(settings, host).auth == "on"
    off = Settings(database_url=database_url, auth="off")
    assert _decided(off, host) == off
    # Loopback asks nobody unless it is told to.
    record.keys.revoke(record.keys.list()[0].id)
    _require_key(settings, "127.0.0.1", None)
    assert _decided(settings, "127.0.0.1") == settings
    with pytest.raises(ParameterError, match="MESHDEFORM_AUTH is on"):
        _require_key(Settings(database_url=database_url, auth="on"), "127.0.0.1", None)
