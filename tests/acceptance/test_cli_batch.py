"""Batches that are killed in the middle: the same command does exactly what is missing."""

from __future__ import annotations

import csv
import json
import signal
from collections import Counter
from pathlib import Path

import psutil
import pytest

from tests.acceptance.cli import call, started
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service, until

pytestmark = pytest.mark.acceptance

ROWS, STEPS = 3, (2, 40, 2)
"""How many rows, and the steps of each: the second one takes long enough to be killed."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a manifest."""
    folder = tmp_path_factory.mktemp("batch")
    write_ellipsoid(folder / "sphere.obj", 1.0)
    write_ellipsoid(folder / "egg.obj", 1.6)
    rows = [f"sphere.obj,egg.obj,{n},{steps}" for n, steps in enumerate(STEPS)]
    (folder / "rows.csv").write_text("\n".join(["asset,target,seed,steps", *rows]) + "\n")
    return folder


def ledger(out: Path) -> list[dict[str, object]]:
    path = out / "ledger.jsonl"
    # What stands before the last line break: a process that writes right now may be half way.
    lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
    return [json.loads(line) for line in lines[1:]]


def done_rows(out: Path) -> Counter[object]:
    return Counter(line["key"] for line in ledger(out) if line["event"] == "done")


def kill_after_a_row(out: Path, *arguments: object, cwd: Path) -> None:
    with started(*arguments, cwd=cwd) as process:
        until("a row is done", lambda: done_rows(out) or process.poll() is not None)
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.returncode == -signal.SIGKILL, "it was over before it could be killed"
        # Nobody goes on deforming behind the next run's back.
        _, alive = psutil.wait_procs(children, timeout=240)
        assert not alive


def test_a_local_batch_that_is_killed_goes_on_where_it_was(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ("batch", folder / "rows.csv", "-o", out, "--set", "checkpoint_every_steps=8")
    kill_after_a_row(out, *arguments, cwd=tmp_path)
    before = done_rows(out)
    assert 0 < len(before) < ROWS
    with (out / "ledger.jsonl").open("ab") as file:
        file.write(b'{"event": "done", "key": "half a li')
    kept = {path: path.stat().st_mtime_ns for path in out.glob("*/result.glb")}
    again = call(*arguments, "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    lines = [json.loads(line) for line in again.stdout.splitlines()]
    assert len(lines) == ROWS - len(before) + 1
    assert lines[-1]["event"] == "summary"
    assert (lines[-1]["rows"], lines[-1]["succeeded"], lines[-1]["failed"]) == (ROWS, ROWS, 0)
    assert set(done_rows(out).values()) == {1}
    finished = [path for path in kept if path.parent.name in {line["name"] for line in ledger(out)[: len(before)]}]
    assert finished
    assert all(path.stat().st_mtime_ns == kept[path] for path in finished)
    assert not (out / ".states").exists()
    with (out / "summary.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["state"] for row in table] == ["succeeded"] * ROWS
    assert [row["seed"] for row in table] == ["0", "1", "2"]
    assert (out / "sheet.png").read_bytes()[:4] == b"\x89PNG"
    whole = call(*arguments, cwd=tmp_path)
    assert whole.returncode == 0
    assert f"{ROWS} of {ROWS} rows are finished already" in whole.stderr


def test_a_batch_at_a_service_that_is_killed_makes_no_job_twice(folder: Path, tmp_path: Path, service: Service) -> None:
    out = tmp_path / "out"
    url = str(service.http.base_url).rstrip("/")
    arguments = ("batch", folder / "rows.csv", "-o", out, "--url", url, "--parallel", 2)
    kill_after_a_row(out, *arguments, cwd=tmp_path)
    # As if it had died between the service's answer and the ledger's line: the job is there, the line is not.
    lines = (out / "ledger.jsonl").read_bytes().splitlines(keepends=True)
    waiting = [n for n, line in enumerate(lines) if json.loads(line).get("event") == "submitted"]
    over = done_rows(out)
    forgotten = next(n for n in reversed(waiting) if json.loads(lines[n])["key"] not in over)
    (out / "ledger.jsonl").write_bytes(b"".join(lines[:forgotten] + lines[forgotten + 1 :]))
    again = call(*arguments, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    listed = service.http.get("/v1/jobs", params={"limit": 100}).json()["jobs"]
    jobs = [job for job in listed if "batch" in job["metadata"]]
    assert len(jobs) == ROWS
    assert {job["state"] for job in jobs} == {"succeeded"}
    assert {job["metadata"]["row"] for job in jobs} == {path.parent.name for path in out.glob("*/result.glb")}
    assert set(done_rows(out).values()) == {1}
    for job in jobs:
        fetched = (out / job["metadata"]["row"] / "result.glb").read_bytes()
        assert fetched == service.artifact(job["id"], "result.glb")


def test_a_row_that_fails_fails_alone_and_is_tried_again_when_asked(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.glb").write_bytes(b"glTF and nothing more")
    (tmp_path / "good.obj").write_bytes((folder / "sphere.obj").read_bytes())
    (tmp_path / "egg.obj").write_bytes((folder / "egg.obj").read_bytes())
    rows = [{"asset": name, "target": "egg.obj", "steps": 1} for name in ("broken.glb", "good.obj")]
    (tmp_path / "rows.jsonl").write_text("\n".join(map(json.dumps, rows)))
    out = tmp_path / "out"
    first = call("batch", "rows.jsonl", "-o", out, "--json", cwd=tmp_path)
    assert first.returncode == 8, first.stderr
    problem = json.loads(first.stderr.splitlines()[-1])
    assert (problem["code"], problem["failed"], problem["succeeded"]) == ("batch_incomplete", 1, 1)
    failed = next(line for line in map(json.loads, first.stdout.splitlines()) if line.get("state") == "failed")
    assert failed["error_code"].startswith("asset_")
    again = call("batch", "rows.jsonl", "-o", out, cwd=tmp_path)
    assert again.returncode == 8
    assert len(ledger(out)) == 2, "without --retry-failed nothing is tried again"
    assert call("batch", "rows.jsonl", "-o", out, "--retry-failed", cwd=tmp_path).returncode == 8
    assert [line["event"] for line in ledger(out)].count("failed") == 2
