"""A job that asks for USDZ, over HTTP: sent, done by a worker, downloaded."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("pxr", reason="needs usd-core (the extra usd)")

from meshdeform.assets import build_glb
from meshdeform.geometry.shapes import icosphere
from meshdeform.record.leases import WorkerIdentity
from meshdeform.runs import start_run
from tests.integration.conftest import Api
from worker.context import WorkerContext
from worker.runner import JobRunner


def glb(height: float) -> bytes:
    mesh = icosphere(1)
    return build_glb(mesh.verts.numpy() * [1.0, height, 1.0], mesh.faces.numpy(), material="clay")


@contextlib.contextmanager
def _listen(_job_id: str) -> Iterator[Any]:
    class Deaf:
        def wait(self, timeout_s: float) -> bool:
            return False

    yield Deaf()


def test_result_usdz_is_listed_and_downloads(api: Api) -> None:
    document = {"params": {"guidance": "target", "preset": "preview", "steps": 2}, "output": {"usd": True}}
    files = {"asset": ("a.glb", glb(1.0)), "target": ("b.glb", glb(2.0))}
    made = api.http.post("/v1/jobs", data={"request": json.dumps(document)}, files=files)
    assert made.status_code == 202, made.text
    job_id = made.json()["id"]
    options = {name: value for name, value in made.json()["output"].items() if name != "morph_path"}
    off = {"morph": False, "compact": False, "subdivide": False, "provenance": False}
    assert options == {**off, "usd": True, "rig": "keep"}
    context = WorkerContext(
        settings=api.settings,
        record=api.record,
        store=api.store,
        listen=_listen,
        start=start_run,
        load_prior=lambda _model: pytest.fail("target guidance needs no prior"),
        device="cpu",
        stopping=lambda: False,
        worker=WorkerIdentity("a worker", "meshdeform", "cpu"),
        renew=lambda: None,
        retry_for_s=60.0,
    )
    JobRunner(context).run(job_id)
    listed = {each["name"]: each for each in api.http.get(f"/v1/jobs/{job_id}/artifacts").json()["artifacts"]}
    assert set(listed) == {"result.glb", "result.usdz", "report.json", "preview.png"}
    answer = api.http.get(listed["result.usdz"]["href"])
    assert (answer.status_code, answer.headers["content-type"]) == (200, "model/vnd.usdz+zip")
    assert answer.headers["content-disposition"] == 'attachment; filename="a-like-b-seed0.usdz"'
    assert hashlib.sha256(answer.content).hexdigest() == listed["result.usdz"]["sha256"]
    with zipfile.ZipFile(io.BytesIO(answer.content)) as package:
        assert package.namelist() == ["result.usdc"]
