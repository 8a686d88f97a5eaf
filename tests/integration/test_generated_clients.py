"""Clients generated from the OpenAPI document, in Python and TypeScript, run a job and download its results."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from meshdeform.runs.base import ArtifactData, RunInput
from tests.fake_kind import FakeKind
from tests.integration.conftest import Api
from tests.worker_world import working

GENERATOR = "tests/.openapi-python-client/0.29.1"
REPORT = {"seed": 0}


class ReportingKind(FakeKind):
    """A fake kind that also writes a JSON artifact, which a generated client must not parse as a document."""

    def start(self, given: RunInput) -> Any:
        """Start a run with two artifacts."""
        run: Any = super().start(given)
        results = run.finish
        report = ArtifactData(json.dumps(REPORT).encode(), "application/json")
        run.finish = lambda: {**results(), "report.json": report}
        return run


@pytest.fixture
def worker(api: Api) -> Iterator[None]:
    with working(api.settings, ReportingKind().start):
        yield


def execute(*command: str | Path, cwd: Path, path: Path | None = None) -> str:
    environment = {**os.environ, **({"PYTHONPATH": str(path)} if path else {})}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=240)
    assert done.returncode == 0, f"{command}: {done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout + done.stderr


@pytest.fixture
def python_client(repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Generate the Python client without a warning, and return its package's name."""
    if not (repository / GENERATOR).is_dir():
        pytest.skip("openapi-python-client is not installed (scripts/test installs it)")
    (tmp_path / "config.yaml").write_text("post_hooks: []\n")
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none", "--fail-on-warning"]
    command += ["--path", str(repository / "openapi/openapi.json"), "--config", "config.yaml"]
    said = execute(*command, "--output-path", "generated_client", cwd=tmp_path, path=repository / GENERATOR)
    assert said.split() == ["Generating", "generated_client"]
    monkeypatch.syspath_prepend(tmp_path)
    return "generated_client"


@pytest.mark.usefixtures("worker")
def test_a_generated_python_client(api: Api, python_client: str, sphere: bytes) -> None:
    def part(name: str) -> Any:
        return importlib.import_module(f"{python_client}.{name}")

    package = Path(part("client").__file__).parent
    for path in package.rglob("*.py"):
        part(".".join(path.relative_to(package).with_suffix("").parts))  # every module can be imported
    models, client = part("models"), part("client").Client(base_url=api.url)
    params = models.DeformParams(preset=models.Preset.PREVIEW, steps=12)
    request = models.JobDocument(prompt="a mushroom", params=params)
    asset = part("types").File(payload=BytesIO(sphere), file_name="sphere.glb")
    checked = part("api.jobs.validate_job").sync(
        client=client, body=models.ValidateJobFilesBody(request=request, asset=asset)
    )
    assert (checked.valid, checked.asset.filename) == (True, "sphere.glb")
    asset.payload.seek(0)
    job = part("api.jobs.create_job").sync(
        client=client, body=models.CreateJobFilesBody(request=request, asset=asset), idempotency_key="generated"
    )
    assert job.asset.size == len(sphere)
    while job.finished_at is None:
        job = part("api.jobs.get_job").sync(job.id, client=client, prefer="wait=10")
    assert job.state == models.JobState.SUCCEEDED
    listed = part("api.artifacts.list_artifacts").sync(job.id, client=client)
    assert [artifact.name for artifact in listed.artifacts] == ["report.json", "result.glb"]
    download = part("api.artifacts.get_artifact").sync
    assert json.loads(download(job.id, "report.json", client=client).payload.read()) == REPORT
    assert int(download(job.id, "result.glb", client=client).payload.read()) > 12
    first = download(job.id, "report.json", client=client, range_="bytes=0-0")
    assert first.payload.read() == b"{"
    assert part("api.jobs.get_asset").sync(job.id, client=client).payload.read() == sphere
    problem = part("api.jobs.get_job").sync("job_" + "0" * 26, client=client)
    assert (type(problem), problem.code) == (models.Problem, "not_found")
