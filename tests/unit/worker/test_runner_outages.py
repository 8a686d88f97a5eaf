"""While the store or the record is away, an attempt waits: it throws nothing away and hears what it is told."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.record.models import JobState
from meshdeform.settings import Settings
from tests.worker_world import EVERY, STEPS, World, away, fail_for_a_while, new_world


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with new_world(tmp_path) as world:
        yield world


def _part(world: World, name: str) -> Any:
    return world.store if name == "store" else getattr(world.record, name)


def test_a_store_that_is_away_for_good_leaves_the_job_to_the_next_attempt(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = world.create()
    with monkeypatch.context() as patch:
        patch.setattr(world.store, "put", away)
        world.runner(retry_for_s=0.3).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.attempt, world.record.artifacts(job.id)) == (JobState.QUEUED, 1, [])
    assert world.run(job).state is JobState.SUCCEEDED


@pytest.mark.parametrize(
    ("part", "method"),
    [("store", "get"), ("store", "put"), ("leases", "checkpoints"), ("leases", "finish")],
)
def test_an_outage_costs_no_attempt(world: World, monkeypatch: pytest.MonkeyPatch, part: str, method: str) -> None:
    job = world.create(checkpoint_every_steps=STEPS)
    calls = fail_for_a_while(monkeypatch, _part(world, part), method, times=2)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
    assert len(calls) > 2


@pytest.mark.parametrize(("part", "method"), [("store", "put"), ("leases", "set_checkpoint")])
def test_a_checkpoint_that_cannot_be_stored_is_stored_a_little_later(
    world: World, monkeypatch: pytest.MonkeyPatch, part: str, method: str
) -> None:
    monkeypatch.setattr("worker.outputs._PAUSE_S", 0.0)
    monkeypatch.setattr("worker.outputs._PAUSE_PER_S", 0.0)
    job = world.create()
    fail_for_a_while(monkeypatch, _part(world, part), method, times=3)
    done = world.run(job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
    assert world.kept(job) == [40, 30, 20, 13], "three tries failed, one after each step"


def test_what_the_store_does_not_keep_as_it_was_written_is_written_again(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, real, broken = world.create(), world.store.put, []

    def put(key: str, data: bytes, *more: Any, **named: Any) -> Any:
        stored = real(key, data, *more, **named)
        if key.endswith("result.glb") and not broken:
            broken.append(key)
            real(key, data[:-1])
        return stored

    monkeypatch.setattr(world.store, "put", put)
    assert world.run(job).state is JobState.SUCCEEDED
    assert broken
    (artifact,) = world.record.artifacts(job.id)
    assert hashlib.sha256(world.store.get(artifact.key)).hexdigest() == artifact.sha256


def test_a_cancel_is_heard_while_the_store_is_away(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    job = world.create()

    def get(key: str, sha256: str = "") -> Any:
        world.record.request_cancel(job.id)
        return away()

    monkeypatch.setattr(world.store, "get", get)
    world.runner(settings=Settings(lease_s=1.0), retry_for_s=60.0).run(job.id)
    assert world.record.get(job.id).state is JobState.CANCELED


def test_a_worker_that_stops_while_the_store_is_away_hands_the_job_back(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = world.create()

    def get(key: str, sha256: str = "") -> Any:
        world.stop = True
        return away()

    monkeypatch.setattr(world.store, "get", get)
    world.runner(retry_for_s=60.0).run(job.id)
    assert world.record.get(job.id).state is JobState.QUEUED


def test_a_worker_that_stops_stores_no_checkpoint_where_it_cannot_and_hands_the_job_back(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = world.create()

    def stop(step: int) -> None:
        if step == 17:
            world.stop = True
            monkeypatch.setattr(world.store, "put", away)

    world.kind.on_step = stop
    assert world.run(job).state is JobState.QUEUED
    assert world.kept(job) == [10]
    assert EVERY == 10
