"""Stages over HTTP: from the client through a real worker's attempt to the artifacts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from meshdeform.client import Client
from meshdeform.errors import ParameterError
from meshdeform.runs import start_run
from meshdeform.settings import Settings
from tests.integration.conftest import DEADLINE_S, serving
from tests.worker_world import working

ARTIFACTS = ["morph.glb", "preview.png", "report.json", "result.glb"]


@pytest.fixture
def settings(tmp_path: Path, redis_url: str) -> Settings:
    return Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-stages")


def test_stages_run(settings: Settings, sphere: bytes, tmp_path: Path) -> None:
    asset = tmp_path / "sphere.glb"
    asset.write_bytes(sphere)
    stages = [{"target": "target", "name": "a shark"}, {"target": "target_2"}]
    params = {"preset": "preview", "steps": 2, "stages": stages}
    with serving(settings) as url, working(settings, start_run), Client(url) as client:
        with pytest.raises(ParameterError, match="A stage needs `target_2`"):
            client.submit(asset, params=params, files={"target": asset})
        job = client.submit(asset, params=params, files={"target": asset, "target_2": asset})
        done = client.wait(job, timeout_s=DEADLINE_S)
        assert done.state.value == "succeeded", done.error
        assert [each.name for each in done.artifacts] == ARTIFACTS
        assert done.progress.total_steps == 4
        assert done.progress.stage is not None
        assert (done.progress.stage.number, done.progress.stage.name) == (2, "target_2")
        report = json.loads(client.read(job.id, "report.json"))
        assert [each["name"] for each in report["stages"]] == ["a shark", "sphere"]
