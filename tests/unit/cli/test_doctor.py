"""The doctor: sees what is wrong, says what to do, never hangs, leaves nothing behind."""

from __future__ import annotations

import contextlib
import json
import socket
import sqlite3
import struct
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from meshdeform.cli import checks
from meshdeform.cli.app import app
from meshdeform.cli.checks import Status, Subject, ok, run_checks
from meshdeform.settings import Settings
from tests.cases import each_case

CARD = {"name": "X", "free": 2**30, "total": 2**31, "works": True}


def subject(folder: Path, **settings: object) -> Subject:
    found = Settings(data_dir=folder / "data", **settings)  # type: ignore[arg-type]
    return Subject(found, host="127.0.0.1", port=8765, url=None, api_key=None, timeout_s=1.0)


@pytest.fixture(autouse=True)
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "check_gpu", lambda _: iter([ok("gpu", "not asked in a unit test")]))


def test_on_an_empty_folder_all_is_well_and_it_stays_empty(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["doctor", "--json", "--data-dir", str(tmp_path / "data")])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["healthy"] is True
    assert {check["status"] for check in document["checks"]} <= {"ok", "skip", "warn"}
    assert list(tmp_path.iterdir()) == []


def test_what_is_away_fails_with_advice_and_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Accepts connections and never answers: what hangs whoever waits without a limit.
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        port = deaf.getsockname()[1]
        monkeypatch.setenv("MESHDEFORM_REDIS_URL", f"redis://:secret@127.0.0.1:{port}/0")
        monkeypatch.setenv("MESHDEFORM_DEVISE", "cuda")
        arguments = ["--data-dir", str(tmp_path), "--timeout", "0.3", "--url", f"http://127.0.0.1:{port}"]
        result = CliRunner().invoke(app, ["doctor", "--json", *arguments])
    assert result.exit_code == 4, result.output
    found = {check["name"]: check for check in json.loads(result.stdout)["checks"]}
    for name in ("redis", "service"):
        assert (found[name]["status"], bool(found[name]["advice"])) == ("fail", True)
    assert found["settings"]["status"] == "warn"
    assert "MESHDEFORM_DEVISE" in found["settings"]["detail"]
    assert "secret" not in result.output
    assert json.loads(result.stderr.splitlines()[-1])["code"] == "unhealthy"


def test_a_check_that_hangs_is_left_behind() -> None:
    never = threading.Event()

    def hang() -> list[checks.Finding]:
        never.wait()
        return []

    def broken() -> list[checks.Finding]:
        raise RuntimeError("a bug")

    found = list(run_checks({"a": (hang, 0.05), "b": (broken, 5.0), "c": (lambda: [ok("c", "well")], 5.0)}))
    never.set()
    assert [(finding.name, finding.status.value) for finding in found] == [("a", "fail"), ("b", "fail"), ("c", "ok")]
    assert "no response within 0.05 s" in found[0].detail


def test_an_extra_that_is_half_there_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"torch", "numba", "scipy", "trimesh", "fast_simplification", "rq"}
    monkeypatch.setattr(checks, "find_spec", lambda name: object() if name in there else None)
    found = {finding.name: finding for finding in checks.check_packages(subject(Path()))}
    assert found["extra deform"].status is found["extra sds"].status is Status.OK
    assert (found["extra worker"].status, found["extra worker"].detail) == (Status.FAIL, "missing: sqlalchemy, obstore")
    assert found["extra redis"].status is Status.SKIP


def test_a_record_is_read_and_not_migrated(tmp_path: Path) -> None:
    from meshdeform.record.database import Database

    here = subject(tmp_path)
    (finding,) = checks.check_database(here)
    assert (finding.status, "will be created at the first start" in finding.detail) == (Status.OK, True)
    assert not here.settings.data_dir.exists()
    Database(here.settings.resolved_database_url).close()
    path = here.settings.data_dir / "meshdeform.sqlite"
    (finding,) = checks.check_database(here)
    assert finding.status is Status.OK
    assert "schema" in finding.detail
    for version, status in (("0001", Status.WARN), ("9999", Status.FAIL)):
        with contextlib.closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("UPDATE alembic_version SET version_num = ?", (version,))
            connection.commit()
            (finding,) = checks.check_database(here)
            assert finding.status is status
            assert connection.execute("SELECT version_num FROM alembic_version").fetchone() == (version,)
    path.write_bytes(b"no database at all" * 100)
    (finding,) = checks.check_database(here)
    assert finding.status is Status.FAIL


def test_a_store_is_tried_and_left_as_it_was_and_one_that_is_full_is_said_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from meshdeform.errors import UnavailableError
    from meshdeform.storage import ObjectStore

    def full(*_: object) -> None:
        raise UnavailableError("No space is left.", advice="Free space.")

    here = subject(tmp_path)
    ObjectStore(here.settings.resolved_storage_url).put("kept", b"x")
    before = sorted(tmp_path.rglob("*"))
    (finding,) = checks.check_store(here)
    assert finding.status is Status.OK
    assert sorted(tmp_path.rglob("*")) == before
    monkeypatch.setattr(ObjectStore, "put", full)
    (finding,) = checks.check_store(here)
    assert (finding.status, finding.advice) == (Status.FAIL, "Free space.")


def test_a_port_that_somebody_has(tmp_path: Path) -> None:
    here = subject(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        here.port = taken.getsockname()[1]
        (finding,) = checks.check_port(here)
    assert finding.status is Status.WARN


@each_case(
    ("device", "driver", "found", "status"),
    [
        ("auto", "", {"build": None, "devices": [], "error": ""}, Status.OK),
        ("cuda", "", {"build": None, "devices": [], "error": ""}, Status.FAIL),
        ("auto", "570.1", {"build": None, "devices": [], "error": ""}, Status.WARN),
        ("auto", "450.1", {"build": "12.8", "devices": [], "error": "The NVIDIA driver is too old"}, Status.FAIL),
        ("auto", "570.1", {"build": "12.8", "devices": [CARD]}, Status.OK),
        ("auto", "570.1", {"build": "12.8", "devices": [{**CARD, "works": False}]}, Status.FAIL),
    ],
)
def test_graphics_cards(device: str, driver: str, found: dict[str, object], status: Status) -> None:
    assert checks._gpu(device, driver, {"torch": "2.13.0", "error": "", **found}).status is status


def test_weights_are_whole_and_those_of_this_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from meshdeform.priors.builtin.network import WEIGHTS

    (finding,) = checks.check_builtin(subject(tmp_path))
    assert finding.status is Status.OK, finding
    place = tmp_path / "priors/builtin/weights/prior.safetensors"
    place.parent.mkdir(parents=True)
    monkeypatch.setattr(checks.meshdeform, "__file__", str(tmp_path / "__init__.py"))
    data = WEIGHTS.read_bytes()
    for damaged in (None, b"", data[:5], data[:-1], struct.pack("<Q", len(data)) + data[8:]):
        if damaged is not None:
            place.write_bytes(damaged)
        (finding,) = checks.check_builtin(subject(tmp_path))
        assert finding.status is Status.FAIL, finding
