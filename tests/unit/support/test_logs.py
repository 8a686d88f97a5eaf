"""Log lines: what they carry, and that each is one line."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

import pytest

from meshdeform.settings import Settings
from meshdeform.support.telemetry import PART, bound, carried, configure_logging, json_line

log = logging.getLogger("tests.logs")


@pytest.fixture(autouse=True)
def _as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Put back what is the process's: handlers, level, hooks."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    logging.captureWarnings(capture=False)


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    printed = capsys.readouterr()
    assert printed.out == ""
    return printed.err.splitlines()


def test_a_json_line_says_when_where_and_about_what(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    configure_logging(Settings(log_format="json"))
    monkeypatch.setenv(PART, "worker")
    monkeypatch.setenv("MESHDEFORM_WORKER_ID", "host:1")
    with bound(job_id="job_1", request_id="req_1"):
        log.warning("step %d\nof %s", 3, "4\u2028", extra={"status": 200})
    log.info("after")
    first, second = (json.loads(line) for line in lines(capsys))
    moment = datetime.fromisoformat(first.pop("time"))
    assert datetime.now(UTC) - timedelta(minutes=1) < moment <= datetime.now(UTC)
    assert moment.utcoffset() == timedelta(0)
    assert first == {
        "level": "warning",
        "logger": "tests.logs",
        "message": "step 3\nof 4\u2028",
        "part": "worker",
        "worker": "host:1",
        "job_id": "job_1",
        "request_id": "req_1",
        "status": 200,
    }
    assert {"job_id", "request_id"}.isdisjoint(second)


def test_an_error_is_one_json_line_with_its_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(Settings(log_format="json"))
    try:
        int("äh\n{")
    except ValueError:
        log.exception("it failed")
    (line,) = lines(capsys)
    assert "Traceback" in json.loads(line)["exception"]
    assert "äh" in json.loads(line)["exception"]


def test_a_text_line_names_what_it_is_about_once_and_what_a_user_wrote_makes_none_of_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    configure_logging(Settings(log_format="json"))
    configure_logging(Settings())  # the last one counts
    with bound(job_id="job_1"):
        log.info("job job_1: attempt 1")
        with bound(request_id="req_1"):
            log.info("stored")
        log.info("told")
    assert [line.partition("INFO    ")[2] for line in lines(capsys)] == [
        "job job_1: attempt 1",
        "stored job=job_1 request=req_1",
        "told job=job_1",
    ]
    log.info("no route %s", "/x\r\n12:00:00 INFO    all is well\x1b[2J")
    (line,) = lines(capsys)
    assert line.endswith(r"no route /x\r\n12:00:00 INFO    all is well\x1b[2J")


def test_a_thread_carries_what_is_bound_only_if_it_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(Settings(log_format="json"))
    with bound(job_id="job_1"):
        for target in (log.info, carried(log.info)):
            thread = threading.Thread(target=target, args=("beat",))
            thread.start()
            thread.join()
    assert [json.loads(line).get("job_id") for line in lines(capsys)] == [None, "job_1"]


def test_the_end_of_a_process_and_of_a_thread_are_json_lines_too() -> None:
    program = """
import threading, warnings
from meshdeform.support.telemetry import configure_logging
from meshdeform.settings import Settings
configure_logging(Settings(log_format="json"))
warnings.warn("old")
def fail(): raise RuntimeError("in a thread")
thread = threading.Thread(target=fail); thread.start(); thread.join()
raise RuntimeError("at the end")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    found = [json.loads(line) for line in done.stderr.splitlines()]
    assert ["old" in found[0]["message"], found[1]["level"], found[2]["level"]] == [True, "error", "critical"]
    assert "in a thread" in found[1]["exception"]
    assert "at the end" in found[2]["exception"]


def test_a_childs_own_json_line_passes_unchanged_and_anything_else_becomes_one() -> None:
    own = '{"message":  "as it is"}'
    assert json_line(own, "worker") == own
    for foreign in ("{not json", "Segmentation fault", '"a string"', ""):
        made = json.loads(json_line(foreign, "worker"))
        assert (made["message"], made["part"], made["logger"]) == (foreign, "worker", "output")
