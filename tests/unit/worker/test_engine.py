"""The prior of a worker is loaded as the settings say, and kept between jobs."""

from __future__ import annotations

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from meshdeform.settings import Settings
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
    assert rehearsed == [(False,)]
    assert gc.isenabled()
    engine.load_prior("some/model")
    engine.load_prior("another/model")
    assert loads == [
        {"model": "some/model", "device": "cpu", "revision": "v2", "dtype": "float16"},
        {"model": "another/model", "device": "cpu", "revision": "", "dtype": "float16"},
    ]


_START = """
import logging, sys
from meshdeform.settings import Settings
from worker.process import torch_engine
logging.basicConfig(level=logging.ERROR)
torch_engine(Settings())
print(*sorted({"torch", "diffusers", "meshdeform.exemplar.engine"} & set(sys.modules)))
"""


def test_a_small_fit_runs_before_the_first_job_and_torch_is_left_to_the_first_optimiser() -> None:
    done = subprocess.run([sys.executable, "-c", _START], capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == ("meshdeform.exemplar.engine", "")


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
