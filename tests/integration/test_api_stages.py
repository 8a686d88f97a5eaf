"""Stages and a generated target over HTTP: from the client through a real worker's attempt to the artifacts."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest

from meshdeform.assets import load_asset
from meshdeform.client import Client
from meshdeform.errors import ModelError, ParameterError
from meshdeform.priors import shap_e
from meshdeform.runs import start_run
from meshdeform.runs.base import JobRun, RunInput
from meshdeform.settings import Settings
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import working

ARTIFACTS = ["morph.glb", "preview.png", "report.json", "result.glb", "target-1.glb"]


@pytest.fixture
def settings(tmp_path: Path, redis_url: str, tiny_shap_e: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    monkeypatch.setattr(shap_e, "GRID", 16)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    return Settings(
        data_dir=tmp_path / "data", redis_url=redis_url, queue="test-stages", allowed_models=[str(tiny_shap_e)]
    )


def test_stages_run_and_a_generated_target_is_there_before_the_fit(
    settings: Settings, tiny_shap_e: Path, sphere: bytes, tmp_path: Path
) -> None:
    seen: list[object] = []

    def watched(given: RunInput) -> JobRun:
        run = start_run(given)
        with Client(url) as own:
            (job,) = own.jobs()
            early = own.read(job.id, "target-1.glb")
            seen.extend(
                [job.state.value, [each.name for each in job.artifacts], len(load_asset(early).surface.positions)]
            )
        return run

    asset = tmp_path / "sphere.glb"
    asset.write_bytes(sphere)
    stages = [{"target": {"prompt": "a shark", "model": tiny_shap_e.name, "steps": 2}}, {"target": "target_2"}]
    params = {"preset": "preview", "steps": 2, "stages": stages}
    with serving(settings) as url, working(settings, watched), Client(url) as client:
        with pytest.raises(ParameterError, match="A stage needs `target_2`"):
            client.submit(asset, params=params)
        job = client.submit(asset, params=params, files={"target_2": asset})
        assert job.params.stages[0].target.model == tiny_shap_e.name
        done = client.wait(job, timeout_s=DEADLINE_S)
        assert done.state.value == "succeeded", done.error
        assert seen[:2] == ["running", ["target-1.glb"]]
        assert seen[2] > 100
        assert [each.name for each in done.artifacts] == ARTIFACTS
        assert done.progress.total_steps == 4
        assert done.progress.stage is not None
        assert (done.progress.stage.number, done.progress.stage.name) == (2, "target_2")
        report = json.loads(client.read(job.id, "report.json"))
        assert [each["name"] for each in report["stages"]] == ["a shark", "sphere"]
        # No path of the server, though the model is a folder of it.
        assert str(tiny_shap_e.parent) not in httpx.get(f"{url}/v1/jobs/{job.id}").text
        assert str(tiny_shap_e.parent) not in json.dumps(report)
        other = {"stages": [{"target": {"prompt": "a shark", "model": "elsewhere"}}]}
        with pytest.raises(ModelError, match="does not run the model 'elsewhere'"):
            client.submit(asset, params=other)
