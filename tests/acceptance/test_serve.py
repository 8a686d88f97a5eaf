"""The promises of `meshdeform serve`, kept under real signals: every accepted job ends, once, with the same bytes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service, serving, until

pytestmark = pytest.mark.acceptance

STEPS, EVERY = 160, 20
REQUEST: dict[str, Any] = {
    "params": {"guidance": "target", "steps": STEPS, "checkpoint_every_steps": EVERY, "seed": 5},
    "metadata": {"shot": "sc010"},
}
ENDLESS = {"params": {"guidance": "target", "steps": 50_000, "checkpoint_every_steps": EVERY}}


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The asset."""
    return write_ellipsoid(tmp_path_factory.mktemp("assets") / "sphere.obj", 1.0)


@pytest.fixture(scope="module")
def egg(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The target."""
    return write_ellipsoid(tmp_path_factory.mktemp("assets") / "egg.obj", 1.6)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, server_folder: Path) -> Iterator[Service]:
    """A service that several tests share; its parts may be killed, it itself may not."""
    with serving(server_folder / "shared") as service:
        yield service


@pytest.fixture(scope="module")
def uninterrupted(service: Service, sphere: Path, egg: Path) -> bytes:
    """The result of the job of this file when nothing disturbs it."""
    job = service.submit(sphere, REQUEST, egg)
    assert service.finished(job)["state"] == "succeeded", service.log
    return service.artifact(job, "result.glb")


def test_a_job_over_http_succeeds_and_its_artifacts_can_be_had(service: Service, sphere: Path, egg: Path) -> None:
    answer = service.post(sphere.read_bytes(), sphere.name, REQUEST, egg)
    assert answer.status_code == 202
    assert answer.headers["location"].endswith(answer.json()["id"])
    job = service.finished(answer.json()["id"])
    assert (job["state"], job["error"]) == ("succeeded", None)
    assert job["metadata"] == {"shot": "sc010"}
    assert job["started_at"] <= job["finished_at"]
    progress = job["progress"]
    assert (progress["step"], progress["total_steps"], progress["fraction"]) == (STEPS, STEPS, 1.0)
    assert progress["attempt"] == 1
    names = {a["name"] for a in service.http.get(f"/v1/jobs/{job['id']}/artifacts").json()["artifacts"]}
    assert {"result.glb", "report.json", "preview.png"} <= names
    assert service.artifact(job["id"], "result.glb")[:4] == b"glTF"
    assert service.artifact(job["id"], "preview.png")[:4] == b"\x89PNG"
    assert json.loads(service.artifact(job["id"], "report.json"))


def test_a_worker_killed_mid_job_costs_nothing_but_time(
    service: Service, sphere: Path, egg: Path, uninterrupted: bytes
) -> None:
    job = service.submit(sphere, REQUEST, egg)
    service.at_step(job, 3 * EVERY)
    worker = service.part("-m", "worker.process")
    supervisor = service.part("-m", "worker")
    worker.kill()
    done = service.finished(job)
    assert (done["state"], done["progress"]["attempt"]) == ("succeeded", 2)
    assert supervisor.is_running()
    assert service.artifact(job, "result.glb") == uninterrupted
    assert json.loads(service.artifact(job, "report.json"))["resumed_from_step"] >= 2 * EVERY


def test_a_running_job_stops_when_it_is_canceled(service: Service, sphere: Path, egg: Path) -> None:
    job = service.submit(sphere, ENDLESS, egg)
    service.at_step(job, 1)
    answer = service.http.post(f"/v1/jobs/{job}/cancel")
    assert answer.status_code in (200, 202), answer.text
    at = service.finished(job)
    assert at["state"] == "canceled"
    assert at["progress"]["step"] < 50_000
    assert service.http.post(f"/v1/jobs/{job}/cancel").status_code == 200


def test_a_queued_job_is_canceled_at_once(service: Service, sphere: Path, egg: Path) -> None:
    first, second = service.submit(sphere, ENDLESS, egg), service.submit(sphere, REQUEST, egg)
    service.at_step(first, 1)
    assert service.http.post(f"/v1/jobs/{second}/cancel").json()["state"] == "canceled"
    service.http.post(f"/v1/jobs/{first}/cancel")
    assert service.finished(first)["state"] == "canceled"
    assert service.job(second)["state"] == "canceled"


def test_a_bad_file_is_refused_and_the_next_job_runs(service: Service, sphere: Path, egg: Path) -> None:
    refused = service.post(b"glTF, but not really", "fake.glb", REQUEST, egg)
    assert 400 <= refused.status_code < 500
    assert refused.headers["content-type"].startswith("application/problem+json")
    assert refused.json()["code"].startswith("asset_")
    job = service.submit(sphere, {**REQUEST, "params": {**REQUEST["params"], "steps": 3}}, egg)
    assert service.finished(job)["state"] == "succeeded"


def test_the_api_comes_back_when_it_is_killed(service: Service) -> None:
    api = _api(service)
    api.kill()
    api.wait(timeout=60)
    # The listening socket is serve's: a new connection waits for the next API instead of being refused.
    assert httpx.get(service.http.base_url.join("/healthz"), timeout=60.0).status_code == 200
    assert _api(service).pid != api.pid


def _api(service: Service) -> psutil.Process:
    return until(
        "an API", lambda: next((p for p in service.family() if "api" in p.cmdline() and "--fd" in p.cmdline()), None)
    )


def test_ctrl_c_leaves_no_process_and_the_next_start_finishes_the_job(
    server_folder: Path, sphere: Path, egg: Path, uninterrupted: bytes
) -> None:
    data = server_folder / "interrupted"
    with serving(data) as first:
        job = first.submit(sphere, REQUEST, egg)
        first.at_step(job, EVERY + 1)
        first.send(signal.SIGINT)
        assert first.wait() == 0, first.log
        assert first.family() == set()
    with serving(data) as second:
        done = second.finished(job)
        assert (done["state"], done["error"]) == ("succeeded", None)
        assert second.artifact(job, "result.glb") == uninterrupted
        assert json.loads(second.artifact(job, "report.json"))["resumed_from_step"] > EVERY


def test_the_page_is_opened_in_the_browser_when_it_is_ready(server_folder: Path, tmp_path: Path) -> None:
    browser, opened = tmp_path / "browser", tmp_path / "opened"
    # It goes on until its window is closed, as some do: the service does not wait for it.
    browser.write_text(f"#!/bin/sh\ncd '{tmp_path}' && echo $1 >begun && mv begun opened && exec sleep 600\n")
    browser.chmod(0o755)
    with serving(server_folder / "opened", "--open", BROWSER=str(browser)) as service:
        until("the browser is started", opened.exists)
        assert opened.read_text() == str(service.http.base_url).rstrip("/") + "/\n"
        assert service.http.get("/readyz").status_code == 200
        service.send(signal.SIGINT)
        assert service.wait() == 0, service.log


def test_a_killed_serve_leaves_no_orphan_and_the_next_start_finishes_the_job(
    server_folder: Path, sphere: Path, egg: Path, uninterrupted: bytes
) -> None:
    data = server_folder / "killed"
    with serving(data) as first:
        job = first.submit(sphere, REQUEST, egg)
        first.at_step(job, EVERY + 1)
        assert len(first.family()) >= 4  # redis, API, supervisor, worker
        first.send(signal.SIGKILL)
        first.wait()
        # At once: the next one waits for what is left of the first.
        with serving(data) as second:
            assert first.family() == set()
            assert second.finished(job)["state"] == "succeeded", second.log
            assert second.artifact(job, "result.glb") == uninterrupted


def test_a_second_serve_on_the_directory_is_refused(service: Service, server_folder: Path) -> None:
    command = [sys.executable, "-P", "-m", "meshdeform", "serve", "--port", "0", "--data-dir", server_folder / "shared"]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 4
    assert f"(process {service.pid})" in refused.stderr
    assert "Traceback" not in refused.stderr
