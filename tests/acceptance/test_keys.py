"""A real `meshdeform serve` that others can reach: no start without a key, and none without it let in."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from tests.acceptance.cli import call
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service, serving, until

pytestmark = pytest.mark.acceptance

REQUEST: dict[str, Any] = {"params": {"steps": 3, "guidance": {"kind": "target"}}}


def meshdeform(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "meshdeform", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_serve_refuses_an_open_address_without_a_key_and_says_how_to_make_one(server_folder: Path) -> None:
    data = server_folder / "open address"
    refused = meshdeform("serve", "--host", "0.0.0.0", "--port", "0", "--data-dir", str(data))
    assert refused.returncode == 3, refused.stderr
    assert "Traceback" not in refused.stderr
    command = f"meshdeform keys create --owner me --data-dir '{data}'"
    assert command in refused.stderr
    assert not (data / "serve.lock").exists()  # nothing was started


@pytest.fixture(scope="module")
def guarded(server_folder: Path) -> Iterator[Service]:
    """A service that asks for keys, as a client with one of them sees it; logging JSON, on loopback."""
    data = server_folder / "guarded"
    flags = ["--owner", "studio", "--requests-per-minute", "0", "--data-dir", str(data), "--json"]
    key = json.loads(call("keys", "create", *flags, cwd=server_folder).stdout)["key"]
    with serving(data, MESHDEFORM_AUTH="on", MESHDEFORM_LOG_FORMAT="json") as service:
        assert service.http.get("/v1/jobs").status_code == 401
        service.http.headers.update({"Authorization": f"Bearer {key}", "X-Request-ID": "shot-10"})
        yield service


def test_a_key_opens_a_job_is_its_owners_and_every_line_is_json(guarded: Service, tmp_path: Path) -> None:
    service = guarded
    sphere, egg = write_ellipsoid(tmp_path / "sphere.obj", 1.0), write_ellipsoid(tmp_path / "egg.obj", 1.6)
    broken = service.http.post(
        "/v1/jobs?signature=secret",
        content=b"--x\r\nnonsense",
        headers={"Content-Type": "multipart/form-data; boundary=x"},
    )
    assert broken.status_code == 422
    job = service.submit(sphere, REQUEST, egg)
    assert service.finished(job)["state"] == "succeeded", service.log
    until("the worker says that it is done", lambda: any(f"{job}: attempt 1 succeeded" in e for e in service.errors))
    lines = [json.loads(line) for line in list(service.errors)]
    assert all(line["message"] is not None and datetime.fromisoformat(line["time"]) for line in lines)
    assert {line["part"] for line in lines} >= {"api", "worker"}
    of_the_job = [line for line in lines if line.get("job_id") == job]
    assert {line["part"] for line in of_the_job} == {"worker"}
    assert all(line.get("worker") for line in of_the_job)
    posted = [line for line in lines if line.get("route") == "/v1/jobs" and line.get("status") == 202]
    assert [(line["request_id"], line["method"]) for line in posted] == [("shot-10", "POST")]
    assert posted[0]["duration_ms"] > 0
    assert "secret" not in service.log
