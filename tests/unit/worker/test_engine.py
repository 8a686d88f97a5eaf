"""The prior of a worker is loaded as the settings say, and kept between jobs."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import pytest

from meshdeform.settings import Settings
from tests.cases import each_case
from worker.process import PriorCache, torch_engine


@pytest.fixture
def loads(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What each prior was loaded with."""
    seen: list[dict[str, Any]] = []

    def load(model: str, **how: Any) -> object:
        seen.append({"model": model, **how})
        return object()

    monkeypatch.setattr("meshdeform.priors.load_prior", load)
    return seen


def test_the_settings_decide_the_revision_and_the_precision(
    loads: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    rehearsed: list[tuple[Any, ...]] = []
    monkeypatch.setattr("meshdeform.runs.rehearsal.rehearse", lambda *given: rehearsed.append((*given, gc.isenabled())))
    settings = Settings(model="some/model", model_revision="v2", dtype="float16", device="cpu")
    engine = torch_engine(settings)
    assert rehearsed == [(None, "cpu", False)]  # a model that may be large is loaded by the first job that needs it
    assert gc.isenabled()
    engine.load_prior("some/model")
    engine.load_prior("another/model")
    assert loads == [
        {"model": "some/model", "device": "cpu", "revision": "v2", "dtype": "float16"},
        {"model": "another/model", "device": "cpu", "revision": "", "dtype": "float16"},
    ]


@each_case(("model", "asked"), [("builtin", True), ("some/model", False)])
def test_a_small_job_runs_before_the_first_one(
    model: str, asked: bool, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tests.fakes import FakePrior

    prior = FakePrior()
    monkeypatch.setattr("meshdeform.priors.load_prior", lambda *_, **__: prior)
    torch_engine(Settings(model=model, device="cpu"))
    assert bool(prior.timesteps) == asked
    assert [record.message for record in caplog.records if record.levelname == "ERROR"] == []


def test_the_last_prior_is_kept_unless_another_one_is_asked_for(loads: list[dict[str, Any]]) -> None:
    cache = PriorCache()
    first = cache.get("a", device="cpu", dtype="float32")
    assert cache.get("a", device="cpu", dtype="float32") is first
    for different in ({"dtype": "float16"}, {"dtype": "float16", "revision": "v2"}):
        assert cache.get("a", device="cpu", **different) is not first
    assert len(loads) == 3


def test_weights_that_were_replaced_are_loaded_again(loads: list[dict[str, Any]], tmp_path: Path) -> None:
    cache, mine = PriorCache(), tmp_path / "mine.safetensors"
    mine.write_bytes(b"one")
    first = cache.get(str(mine), device="cpu")
    assert cache.get(str(mine), device="cpu") is first
    mine.write_bytes(b"another")
    assert cache.get(str(mine), device="cpu") is not first
    assert len(loads) == 2
