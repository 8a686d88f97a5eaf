"""`result.glb?strength=`: made by a real child process, stored once, validated, and read by both clients."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.assets.limits import Limits, run_child
from meshdeform.client import Client
from meshdeform.runs import derive
from meshdeform.runs.derive import DerivedInput
from service.downloads import strengths
from tests.integration.conftest import Api
from tests.integration.http_calls import check_problem, finished_job, kept


@pytest.fixture
def job_id(api: Api, sphere: bytes) -> str:
    """A finished job that has made an ellipsoid of the sphere."""
    source = load_asset(sphere)
    result = source.replace(source.surface.positions * [1.0, 2.0, 1.0])
    files = {"asset": kept(api, sphere)}
    return finished_job(api, result, files=files, more={"report.json": b"{}"}, prompt="an egg")


def positions(data: bytes) -> NDArray[np.float64]:
    return load_asset(data).surface.positions


def test_a_strength_is_made_once_and_can_be_resumed_like_any_artifact(
    api: Api, job_id: str, sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(derive, "run_child", run_child)  # a real child, once
    url = f"/v1/jobs/{job_id}/artifacts/result.glb"
    half = api.http.get(url, params={"strength": 0.5})
    assert half.status_code == 200, half.text
    np.testing.assert_allclose(positions(half.content), positions(sphere) * [1.0, 1.5, 1.0], atol=0.02)
    assert half.headers["content-disposition"] == 'attachment; filename="sphere-an-egg-seed0-strength50.glb"'
    assert half.headers["etag"] == f'"{hashlib.sha256(half.content).hexdigest()}"'
    monkeypatch.setattr(strengths, "derive", None)  # from here on nothing is made
    again = {"If-None-Match": half.headers["etag"]}
    assert api.http.get(url, params={"strength": 0.5}, headers=again).status_code == 304
    part = api.http.get(url, params={"strength": 0.5}, headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, half.content[100:200])
    assert api.http.get(url, params={"strength": 1}).content == api.http.get(url).content
    with Client(api.url) as client:
        assert client.read(job_id, "result.glb", strength=0.5) == half.content
    # Deleting the job removes them, too.
    assert len(list(api.store.list(f"jobs/{job_id}/strengths/"))) == 1
    assert api.http.delete(f"/v1/jobs/{job_id}").status_code == 204
    assert not list(api.store.list(f"jobs/{job_id}/"))


def test_only_a_few_strengths_of_a_job_are_kept(api: Api, job_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fake(_name: str, given: DerivedInput, output: Path, _limits: Limits) -> None:
        output.write_bytes(f"{given.strength}".encode())

    monkeypatch.setattr(strengths, "derive", fake)
    monkeypatch.setattr(strengths, "_KEPT_PER_JOB", 2)
    for strength in ("0.1", "0.2", "0.3", "0.1"):
        answer = api.http.get(f"/v1/jobs/{job_id}/artifacts/result.glb", params={"strength": strength})
        assert (answer.status_code, answer.text) == (200, strength)
    assert len(list(api.store.list(f"jobs/{job_id}/strengths/"))) == 2


def test_what_cannot_be_is_refused(api: Api, job_id: str) -> None:
    url = f"/v1/jobs/{job_id}/artifacts"
    for value in ("1.51", "-0.01", "0.123", "half", "nan"):
        check_problem(api.http.get(f"{url}/result.glb?strength={value}"), 422, "parameter_invalid")
    problem = check_problem(api.http.get(f"{url}/report.json?strength=0.5"), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["query", "strength"]
    check_problem(api.http.get(f"{url}/other.glb?strength=0.5"), 404, "not_found")
    # A signature covers the query: a signed URL of the result opens no other strength.
    signed = api.http.post(f"{url}/result.glb/url").json()["url"]
    check_problem(api.http.get(f"{signed}&strength=0.5"), 403, "forbidden")
