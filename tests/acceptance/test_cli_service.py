"""A service from the shell: run, watch, wait, fetch, cancel, jobs, with real processes, signals and a terminal."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest

from tests.acceptance.cli import answer, call, on_a_terminal, run, started
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service

pytestmark = pytest.mark.acceptance

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sphere and an egg."""
    folder = tmp_path_factory.mktemp("cli")
    write_ellipsoid(folder / "sphere.obj", 1.0)
    write_ellipsoid(folder / "egg.obj", 1.6)
    return folder


@pytest.fixture
def url(service: Service) -> str:
    """Its address."""
    return str(service.http.base_url).rstrip("/")


def submit(folder: Path, url: str, *more: str) -> str:
    done = call("run", "sphere.obj", "--target", "egg.obj", *more, "--detach", "--quiet", "--url", url, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.strip()


def test_a_job_from_its_submission_to_its_files(folder: Path, service: Service, url: str, tmp_path: Path) -> None:
    job = submit(folder, url, "--steps", "12", "--label", "shot=sc010", "--morph")
    assert service.job(job)["metadata"] == {"shot": "sc010"}
    watched = run("watch", job, "--url", url, cwd=folder)
    assert watched.returncode == 0, watched.stderr
    assert watched.stdout == f"{job}  succeeded\n"
    assert not CONTROL.search(watched.stderr), "a log is no place for control characters"
    assert "step 12/12  loss " in watched.stderr
    # A line for each of the few phases, for the last step, and else one in five seconds.
    assert len(watched.stderr.splitlines()) < 30
    files = answer("fetch", job, "-o", tmp_path / "out", "--url", url, cwd=folder)["files"]
    assert {file["name"] for file in files} == {"morph.glb", "preview.png", "report.json", "result.glb"}
    for file in files:
        assert (folder / file["path"]).read_bytes() == service.artifact(job, file["name"])
    one = call("fetch", job, "-o", tmp_path / "one", "--name", "result.glb", "--url", url, cwd=folder)
    assert one.stdout.splitlines() == [str(tmp_path / "one/result.glb")]
    listed = answer("jobs", "--state", "succeeded", "--url", url, cwd=folder)["jobs"]
    assert job in {entry["id"] for entry in listed}
    assert call("wait", job, "--url", url, cwd=folder).stdout == f"{job}  succeeded\n"
    assert call("cancel", job, "--url", url, cwd=folder).returncode == 3, "what is over stays as it is"


def test_jobs_are_found_by_label_branched_retried_fetched_and_deleted(
    folder: Path, service: Service, url: str, tmp_path: Path
) -> None:
    more = ("--steps", "4", "--set", "checkpoint_every_steps=2")
    job = submit(folder, url, *more, "--label", "shot=sc020", "--label", "take=1")
    assert call("wait", job, "-q", "--url", url, cwd=folder).stdout == ""
    found = answer("jobs", "--label", "shot=sc020", "--label", "take=1", "--url", url, cwd=folder)["jobs"]
    assert [each["id"] for each in found] == [job]
    assert answer("jobs", "--label", "shot=sc020", "--label", "take=2", "--url", url, cwd=folder)["jobs"] == []

    (asset,) = answer("fetch", job, "--asset", "-o", tmp_path, "--url", url, cwd=folder)["files"]
    assert Path(asset["path"]).read_bytes() == (folder / "sphere.obj").read_bytes()
    (mesh,) = answer("fetch", job, "--step", "2", "-o", tmp_path, "--url", url, cwd=folder)["files"]
    assert (Path(mesh["path"]).name, Path(mesh["path"]).read_bytes()[:4]) == ("step-2.glb", b"glTF")
    assert call("fetch", job, "--step", "3", "-o", tmp_path, "--url", url, cwd=folder).returncode == 3

    branched = answer("branch", job, "a mushroom", "--step", "2", "--steps", "1", "--url", url, cwd=folder)
    assert (branched["origin"]["job_id"], branched["origin"]["step"]) == (job, 2)
    refused = call("retry", job, "--url", url, cwd=folder)
    assert refused.returncode == 3, "it succeeded"
    left = submit(folder, url, "--steps", "2000")
    call("cancel", left, "--url", url, cwd=folder)
    call("wait", left, "--url", url, cwd=folder)
    again = answer("retry", left, "--max-run-s", "7200", "--url", url, cwd=folder)
    assert (again["origin"]["job_id"], again["max_run_s"]) == (left, 7200)
    assert call("cancel", again["id"], "--url", url, cwd=folder).returncode == 0
    assert call("wait", branched["id"], "-q", "--url", url, cwd=folder).returncode == 0
    assert answer("delete", job, branched["id"], "--url", url, cwd=folder) == {"deleted": [job, branched["id"]]}
    assert call("delete", job, "--url", url, cwd=folder).returncode == 3


def test_on_a_terminal_there_is_a_bar_with_loss_and_time_left(folder: Path, url: str) -> None:
    job = submit(folder, url, "--steps", "20")
    code, seen = on_a_terminal("watch", job, "--url", url, cwd=folder)
    assert code == 0, seen
    assert "\x1b[" in seen
    assert "━" in seen
    assert re.search(r"loss \d+\.\d{4}", seen)
    assert re.search(r"\d+ s left", seen)
    assert f"{job}  succeeded" in seen


def test_a_run_on_a_service_fetches_its_files_with_one_document(folder: Path, url: str, tmp_path: Path) -> None:
    found = answer(
        "run", "sphere.obj", "--target", "egg.obj", "--steps", 2, "-o", tmp_path / "o", "--url", url, cwd=folder
    )
    assert found["state"] == "succeeded"
    assert (tmp_path / "o/result.glb").read_bytes()[:4] == b"glTF"
    assert {file["name"] for file in found["files"]} == {"preview.png", "report.json", "result.glb"}


def test_ctrl_c_leaves_the_job_and_says_how_to_come_back(folder: Path, service: Service, url: str) -> None:
    with service.held_jobs():
        job = submit(folder, url, "--steps", "8")
        with started("watch", job, "--json", "--url", url, cwd=folder) as process:
            assert process.stdout is not None
            events = (json.loads(line) for line in process.stdout)
            assert next(event for event in events if event["type"] == "progress")["job_id"] == job
            process.send_signal(signal.SIGINT)
            _, said = process.communicate()
        assert process.returncode == 130, said
        problem = json.loads(said.splitlines()[-1])
        assert (problem["code"], problem["exit_code"]) == ("interrupted", 130)
        assert f"meshdeform watch {job} --url {url}" in problem["advice"]
        assert f"meshdeform cancel {job} --url {url}" in problem["advice"]
        assert service.job(job)["state"] == "running"
        late = call("wait", job, "--timeout", "0.2", "--json", "--url", url, cwd=folder)
        assert late.returncode == 7
        assert json.loads(late.stderr.splitlines()[-1])["code"] == "timed_out"
        assert answer("cancel", job, "--url", url, cwd=folder)["jobs"][0]["id"] == job
    ended = call("wait", job, "--json", "--url", url, cwd=folder)
    assert ended.returncode == 6, ended.stderr
    assert json.loads(ended.stdout)["jobs"][0]["state"] == "canceled"
