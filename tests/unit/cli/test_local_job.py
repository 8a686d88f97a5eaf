"""The job behind `meshdeform run`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from meshdeform.cli.local_job import LocalJob, Outputs
from meshdeform.errors import ModelError
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from meshdeform.testing import FakePrior
from tests.unit.assets.test_archive import image, scene
from tests.unit.assets.test_replace import DOT


class Silent:
    """Tells nobody."""

    def phase(self, name: str) -> None: ...

    def step(self, step: int, total_steps: int, loss: float, eta_s: float | None = None) -> None: ...


def test_the_prior_is_loaded_as_the_settings_say(tmp_path: Path) -> None:
    seen: list[Any] = []

    def load(model: str, **how: Any) -> Any:
        seen.append((model, how))
        raise ModelError("Enough was seen.")

    asset = tmp_path / "a.glb"
    asset.write_bytes(b"is not read before the prior is there")
    settings = Settings(model="some/model", model_revision="v2", dtype="bfloat16", device="cpu")
    outputs = Outputs(tmp_path / "result.glb", tmp_path / "report.json", tmp_path / "preview.png")
    with pytest.raises(ModelError, match="Enough"):
        LocalJob(asset, JobRequest(prompt="a vase"), settings, outputs, load=load).run(Silent())
    assert seen == [("some/model", {"device": "cpu", "revision": "v2", "dtype": "bfloat16"})]


def test_the_files_beside_a_gltf_come_along(tmp_path: Path) -> None:
    for name, data in scene().items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    outputs = Outputs(tmp_path / "result.glb", tmp_path / "report.json", tmp_path / "preview.png")
    request = JobRequest.model_validate({"prompt": "an egg", "params": {"preset": "preview", "steps": 1}})
    job = LocalJob(
        tmp_path / "model/scene.gltf", request, Settings(device="cpu"), outputs, load=lambda *_, **__: FakePrior()
    )
    job.run(Silent())
    assert image(outputs.result.read_bytes()) == DOT
