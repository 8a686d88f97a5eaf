"""A job that continues another one: a retry ends as if never interrupted, a branch begins with its shape."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import CheckpointError
from meshdeform.record.models import Job, JobState, Origin, OriginMode
from tests.worker_world import World, new_world


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with new_world(tmp_path) as world:
        yield world


def continued(world: World, mode: OriginMode, data: bytes | None, **params: Any) -> Job:
    """A job with an origin, whose checkpoint is stored; without one where there are no bytes."""
    sha256 = hashlib.sha256(data).hexdigest() if data is not None else ""
    key = f"assets/{sha256}" if data is not None else ""
    if data is not None:
        world.store.put(key, data)
    return world.create(origin=Origin(job_id="job_before", step=30, mode=mode, key=key, sha256=sha256), **params)


def state(world: World) -> tuple[bytes, bytes]:
    """The checkpoint of step 30 of an uninterrupted run, and that run's result."""
    whole = world.create()
    world.run(whole)
    (key,) = [each.key for each in world.record.leases.checkpoints(whole.id) if each.step == 30]
    return world.store.get(key), world.result(whole)


def test_a_retry_goes_on_from_the_checkpoint_to_the_same_bytes(world: World) -> None:
    data, result = state(world)
    job = continued(world, OriginMode.RETRY, data)
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-1] == 30
    assert world.result(job) == result


def test_its_own_checkpoints_come_first(world: World) -> None:
    data, _ = state(world)
    job = continued(world, OriginMode.RETRY, data)
    world.kind.on_step = lambda step: setattr(world, "stop", step == 44)
    world.run(job)
    world.stop, world.kind.on_step = False, lambda step: None
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at[-2:] == [30, 44]


def test_a_retry_without_one_or_with_a_torn_one_begins_anew(world: World) -> None:
    data, result = state(world)
    torn = continued(world, OriginMode.RETRY, data)
    assert torn.origin is not None
    world.store.put(torn.origin.key, data[:-2])
    for job in (torn, continued(world, OriginMode.RETRY, None)):
        assert world.run(job).state is JobState.SUCCEEDED
        assert world.kind.started_at[-1] == 0
        assert world.result(job) == result


def test_a_branch_begins_with_the_shape_at_step_0(world: World) -> None:
    data, result = state(world)
    job = continued(world, OriginMode.BRANCH, data, steps=5)
    assert world.run(job).state is JobState.SUCCEEDED
    given = world.kind.started[-1]
    assert (given.checkpoint, given.initial, world.kind.started_at[-1]) == (None, data, 0)
    value = json.loads(data)["value"]
    for step in range(1, 6):
        value = value * 3 + step
    assert world.result(job) == str(value).encode() != result


def test_a_branch_without_its_shape_fails(world: World) -> None:
    data, _ = state(world)
    job = continued(world, OriginMode.BRANCH, data)
    assert job.origin is not None
    world.store.delete(job.origin.key)
    done = world.run(job)
    assert done.error is not None
    assert (done.state, done.error.code) == (JobState.FAILED, CheckpointError.code)
