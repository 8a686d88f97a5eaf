"""A fit to an exemplar on a worker: it is handed back, canceled and started again like any other job."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from meshdeform.record.models import Job, JobState, NewJob, StoredFile
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.exemplar_kind import STEPS
from tests.fake_exemplars import FakeFit, FakeStage, install
from tests.worker_world import World, new_world

BALL = icosphere(1)
GUIDANCE = {"kind": "exemplar", "source_noun": "pumpkin", "orientation": 0.0}


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    install(monkeypatch)
    with new_world(tmp_path) as world:
        yield world
    FakeFit.made.clear()


def create(world: World, **params: Any) -> Job:
    stored = world.store.put("assets/ball", build_glb(BALL.verts, BALL.faces), "model/gltf-binary")
    asset = StoredFile(key="assets/ball", filename="ball.glb", size=stored.size, sha256=stored.sha256)
    document = {"prompt": "a giraffe", "params": {"guidance": GUIDANCE, **params}}
    return world.record.create(NewJob(JobRequest.model_validate(document), {"asset": asset}))


def run(world: World, job: Job) -> Job:
    world.runner(start=start_run).run(job.id)
    return world.record.get(job.id)


def result(world: World, job: Job) -> bytes:
    (artifact,) = [each for each in world.record.artifacts(job.id) if each.name == "result.glb"]
    return world.store.get(artifact.key)


def meanwhile(monkeypatch: pytest.MonkeyPatch, act: Callable[[], Any]) -> None:
    """Act once, before the last stage of the next fit."""
    whole = FakeFit.__iter__

    def interrupted(fit: FakeFit) -> Iterator[FakeStage]:
        for stage in whole(fit):
            if stage.share == 1.0:
                monkeypatch.setattr(FakeFit, "__iter__", whole)
                act()
            yield stage

    monkeypatch.setattr(FakeFit, "__iter__", interrupted)


def test_it_asks_for_no_model_and_its_steps_are_told(world: World) -> None:
    done = run(world, create(world))
    assert (done.state, done.progress.step, done.progress.total_steps) == (JobState.SUCCEEDED, STEPS, STEPS)
    assert world.priors == []
    assert world.kept(done) == []  # it is shorter than the interval of checkpoints


def test_one_that_is_handed_back_starts_again_to_the_same_bytes(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(world, create(world))
    job = create(world)
    meanwhile(monkeypatch, lambda: setattr(world, "stop", True))
    handed_back = run(world, job)
    assert (handed_back.state, handed_back.attempt) == (JobState.QUEUED, 1)
    assert len(world.kept(job)) == 1
    world.stop = False
    done = run(world, job)
    assert (done.state, done.attempt) == (JobState.SUCCEEDED, 2)
    assert result(world, done) == result(world, whole)


def test_a_cancel_acts_between_two_stages(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    job = create(world)
    meanwhile(monkeypatch, lambda: world.record.request_cancel(job.id))
    assert run(world, job).state is JobState.CANCELED


def test_shapes_on_the_way_are_stored_where_they_are_asked_for(world: World) -> None:
    done = run(world, create(world, checkpoint_every_steps=5))
    assert world.kept(done) == [15, 10, 5]
