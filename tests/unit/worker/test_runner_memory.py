"""A device without memory: what was done is saved, the process ends for a clean context, and not without end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.errors import ModelError
from meshdeform.record.models import Job, JobState
from meshdeform.settings import Settings
from tests.fake_kind import OutOfMemoryError
from tests.worker_world import World, new_world
from worker.attempt import is_out_of_memory


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    with new_world(tmp_path) as world:
        yield world


def run_out(world: World, job: Job, at: int) -> Job:
    """Run the job to a step that finds no memory."""

    def fail(step: int) -> None:
        if step == at:
            raise OutOfMemoryError("CUDA out of memory.")

    world.kind.on_step = fail
    return world.run(job)


def test_the_state_before_the_step_is_stored_and_the_process_ends(world: World) -> None:
    whole = world.create()
    world.run(whole)
    job = world.create()
    left = run_out(world, job, at=17)
    assert (left.state, left.attempt, left.oom_attempts) == (JobState.QUEUED, 1, 1)
    assert world.kept(job) == [16, 10]
    assert world.renewals == ["now"]
    world.kind.on_step = lambda step: None
    assert world.run(job).state is JobState.SUCCEEDED
    assert world.kind.started_at == [0, 0, 16]
    assert world.result(job) == world.result(whole)


def test_after_so_many_times_it_fails(world: World) -> None:
    job = world.create()
    for _ in range(Settings().max_attempts):
        left = run_out(world, job, at=17)
    assert left.error is not None
    assert (left.state, left.error.code) == (JobState.FAILED, "gpu_oom")
    assert len(world.renewals) == Settings().max_attempts


def test_it_may_come_before_the_first_step(world: World) -> None:
    job = world.create(guidance="sds")

    def load(model: str) -> Any:
        raise ModelError("The model cannot be loaded.") from OutOfMemoryError("CUDA out of memory.")

    world.runner(load_prior=load).run(job.id)
    left = world.record.get(job.id)
    assert (left.state, left.oom_attempts, world.renewals) == (JobState.QUEUED, 1, ["now"])


def test_what_is_taken_for_it() -> None:
    import torch

    assert is_out_of_memory(torch.OutOfMemoryError("CUDA out of memory."))
    assert is_out_of_memory(RuntimeError("CUDA error: out of memory\nCUDA kernel errors might be"))
    assert not is_out_of_memory(MemoryError())
    assert not is_out_of_memory(RuntimeError("no memory of it"))
    assert not is_out_of_memory(None)
