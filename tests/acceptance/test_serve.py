"""The promises of `meshdeform serve`, kept under real signals: every accepted job ends, once, with the same bytes."""

from __future__ import annotations

import json
import signal
import sqlite3
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from meshdeform.record.repository import JobRecord
from tests.acceptance.cli import call, run
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Gate, Service, serving, until
from tests.cases import each_case

pytestmark = pytest.mark.acceptance

STEPS, EVERY = 18, 2
REQUEST: dict[str, Any] = {
    "params": {"steps": STEPS, "checkpoint_every_steps": EVERY, "seed": 5, "guidance": {"kind": "target"}},
    "metadata": {"shot": "sc010"},
}


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The asset."""
    return write_ellipsoid(tmp_path_factory.mktemp("assets") / "sphere.obj", 1.0)


@pytest.fixture(scope="module")
def egg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The target."""
    return write_ellipsoid(tmp_path_factory.mktemp("assets") / "egg.obj", 1.6)


@pytest.fixture(scope="module")
def uninterrupted(service: Service, sphere: Path, egg: Path) -> str:
    """The job of this file when nothing disturbs it, finished."""
    answer = service.post(sphere.read_bytes(), sphere.name, REQUEST, egg)
    assert answer.status_code == 202
    job = str(answer.json()["id"])
    assert answer.headers["location"].endswith(job)
    assert service.finished(job)["state"] == "succeeded", service.log
    return job


def test_the_api_comes_back_when_it_is_killed(service: Service) -> None:
    api = _api(service)
    api.kill()
    api.wait(timeout=240)
    # The listening socket is serve's: a new connection waits for the next API instead of being refused.
    assert httpx.get(service.http.base_url.join("/healthz"), timeout=240).status_code == 200
    assert _api(service).pid != api.pid


def _api(service: Service) -> psutil.Process:
    return until(
        "an API",
        lambda: next((p for p in service.family() if "service" in p.cmdline() and "--fd" in p.cmdline()), None),
    )


def test_a_job_outlives_its_worker_ctrl_c_and_a_killed_serve_with_the_same_bytes(
    service: Service, server_folder: Path, tmp_path: Path, sphere: Path, egg: Path, uninterrupted: str
) -> None:
    data, gate = server_folder / "interrupted", Gate(tmp_path / "gate")
    with serving(data, MESHDEFORM_FAILPOINTS=f"worker.step=pause@5:{gate.path}") as first:
        job = first.submit(sphere, REQUEST, egg)
        gate.wait()
        supervisor = first.part("-m", "worker")
        gate.close()
        first.part("-m", "worker.process").kill()
        # The next one begins at step 4, where the last checkpoint was, and waits at its own fifth step.
        gate.wait()
        assert supervisor.is_running()
        assert first.job(job)["progress"]["attempt"] == 2
        first.send(signal.SIGINT)
        until("serve stops", lambda: "| stopping" in first.log)
        gate.open()
        assert first.wait() == 0, first.log
        assert first.family() == set()
    gate.close()
    with serving(data, MESHDEFORM_FAILPOINTS=f"worker.step=pause@3:{gate.path}") as second:
        gate.wait()
        assert len(second.family()) >= 4  # redis, API, supervisor, worker
        second.send(signal.SIGKILL)
        gate.open()
        second.wait()
        # At once: the next one waits for what is left of the second.
        browser, opened = tmp_path / "browser", tmp_path / "opened"
        # It runs until its window is closed, as some do: the service does not wait for it.
        browser.write_text(f"#!/bin/sh\ncd '{tmp_path}' && echo $1 >begun && mv begun opened && exec sleep 600\n")
        browser.chmod(0o755)
        with serving(data, "--open", BROWSER=str(browser)) as third:
            assert second.family() == set()
            done = third.finished(job)
            assert (done["state"], done["error"]) == ("succeeded", None), third.log
            assert third.artifact(job, "result.glb") == service.artifact(uninterrupted, "result.glb")
            assert json.loads(third.artifact(job, "report.json"))["resumed_from_step"] >= 9
            until("the browser is started", opened.exists)
            assert opened.read_text() == str(third.http.base_url).rstrip("/") + "/\n"
            assert third.http.get("/readyz").status_code == 200
            third.send(signal.SIGINT)
            assert third.wait() == 0, third.log


# One that others can reach: no start without a key, and none without it let in


def test_serve_refuses_an_open_address_without_a_key_and_says_how_to_make_one(server_folder: Path) -> None:
    data = server_folder / "open address"
    refused = run("serve", "--host", "0.0.0.0", "--port", "0", "--data-dir", data, cwd=server_folder)
    assert refused.returncode == 3, refused.stderr
    assert "Traceback" not in refused.stderr
    command = f"meshdeform keys create --owner me --data-dir '{data}'"
    assert command in refused.stderr
    assert not (data / "serve.lock").exists()  # nothing was started


@each_case("command", ["serve", "api", "worker"])
def test_a_record_of_another_version_ends_a_start_at_once(server_folder: Path, command: str) -> None:
    data = server_folder / f"foreign to {command}"
    data.mkdir(exist_ok=True)
    url = f"sqlite:///{data / 'meshdeform.sqlite'}"
    JobRecord(url).close()
    with closing(sqlite3.connect(data / "meshdeform.sqlite")) as record, record:
        record.execute("UPDATE alembic_version SET version_num = '0004'")
    own = ["--port", "0"] if command != "worker" else []
    place = ["--data-dir", data] if command == "serve" else []
    elsewhere = {"MESHDEFORM_DATABASE_URL": url, "MESHDEFORM_REDIS_URL": "redis://127.0.0.1:1/0"}
    refused = run(command, *own, *place, cwd=server_folder, **({} if command == "serve" else elsewhere))
    assert refused.returncode == 3, refused.stderr
    assert "Install the version that wrote it" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_key_opens_a_job_is_its_owners_and_every_line_is_json(server_folder: Path, sphere: Path, egg: Path) -> None:
    data = server_folder / "guarded"
    flags = ["--owner", "studio", "--requests-per-minute", "0", "--data-dir", str(data), "--json"]
    key = json.loads(call("keys", "create", *flags, cwd=server_folder).stdout)["key"]
    with serving(data, MESHDEFORM_AUTH="on", MESHDEFORM_LOG_FORMAT="json") as service:
        assert service.http.get("/v1/jobs").status_code == 401
        service.http.headers.update({"Authorization": f"Bearer {key}", "X-Request-ID": "shot-10"})
        broken = service.http.post(
            "/v1/jobs?signature=secret",
            content=b"--x\r\nnonsense",
            headers={"Content-Type": "multipart/form-data; boundary=x"},
        )
        assert broken.status_code == 422
        job = service.submit(sphere, {"params": {"steps": 3, "guidance": {"kind": "target"}}}, egg)
        assert service.finished(job)["state"] == "succeeded", service.log
        until(
            "the worker says that it is done", lambda: any(f"{job}: attempt 1 succeeded" in e for e in service.errors)
        )
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
