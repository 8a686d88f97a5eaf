"""The job behind `meshdeform run`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from meshdeform.cli.local_job import LocalJob, Outputs
from meshdeform.errors import ModelError
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings


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
