"""Readings in the object store: they are there for one to two weeks, and take no more than they may."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from meshdeform.errors import UnavailableError
from meshdeform.storage import ObjectStore, readings
from meshdeform.storage.readings import StoredReadings, remove_old_readings

WEEK_S = 7 * 86_400


@pytest.fixture(params=["folder", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> ObjectStore:
    return ObjectStore(tmp_path / "store" if request.param == "folder" else "memory://")


def in_week(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    monkeypatch.setattr(readings.time, "time", lambda: number * WEEK_S + 5.0)


def test_a_reading_is_there_until_the_end_of_the_next_week(store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = StoredReadings(store)
    store.put("assets/ab", b"asset")
    assert kept.get("k1") is None
    in_week(monkeypatch, 100)
    kept.put("k1", b"one")
    kept.put("k1", b"two")
    in_week(monkeypatch, 101)
    kept.put("k2", b"three")
    remove_old_readings(store)
    assert (kept.get("k1"), kept.get("k2")) == (b"two", b"three")
    in_week(monkeypatch, 102)
    assert kept.get("k1") is None
    remove_old_readings(store)
    assert [key for key, _ in store.list()] == ["assets/ab", "readings/101/k2"]


def test_the_older_week_goes_first_where_all_take_too_much(store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = StoredReadings(store)
    for week in (100, 101):
        in_week(monkeypatch, week)
        kept.put(f"k{week}", b"0123456789")
    monkeypatch.setattr(readings, "_MOST_BYTES_OF_ALL", 19)
    remove_old_readings(store)
    assert [key for key, _ in store.list()] == ["readings/101/k101"]
    monkeypatch.setattr(readings, "_MOST_OF_ALL", 0)
    remove_old_readings(store)
    assert list(store.list()) == []
    monkeypatch.setattr(readings, "_MOST_BYTES", 5)
    kept.put("large", b"0123456789")
    assert kept.get("large") is None


def test_a_store_that_is_away_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    store = ObjectStore(tmp_path / "store")

    def away(*_arguments: object, **_more: object) -> bytes:
        raise UnavailableError("The object store does not answer.")

    for name in ("get", "put"):
        monkeypatch.setattr(store, name, away)
    with caplog.at_level(logging.WARNING):
        StoredReadings(store).put("k", b"data")
        assert StoredReadings(store).get("k") is None
    assert len(caplog.records) == 2
