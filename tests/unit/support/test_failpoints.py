"""Failpoints strike where and when they are told to, and nothing else is called one."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from meshdeform.support.failpoints import FAILPOINTS, failpoint

TWICE = (
    "from meshdeform.support.failpoints import failpoint;"
    " failpoint('worker.step'); failpoint('worker.step'); print('alive')"
)


def run(points: str, code: str = TWICE) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MESHDEFORM_FAILPOINTS": points}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)


def test_the_list_and_the_calls_agree(repository: Path) -> None:
    sources = [path for top in ("meshdeform", "service", "worker") for path in (repository / top).rglob("*.py")]
    calls = [name for path in sources for name in re.findall(r"failpoint\(\"([^\"]+)\"\)", path.read_text())]
    assert sorted(calls) == sorted(FAILPOINTS), "each name is called at one place, and each call has a name of the list"
    assert len(set(FAILPOINTS)) == len(FAILPOINTS)


def test_without_the_variable_nothing_happens() -> None:
    for name in FAILPOINTS:
        failpoint(name)


def test_kill_is_a_sigkill_at_its_own_place_only() -> None:
    assert run("worker.step=kill").returncode == -signal.SIGKILL
    assert run("worker.told=kill").stdout == "alive\n"


def test_raise_raises() -> None:
    done = run("worker.told=kill,worker.step=raise")
    assert done.returncode == 1
    assert "RuntimeError: failpoint worker.step" in done.stderr


@pytest.mark.parametrize(("hit", "struck"), [(1, True), (2, True), (3, False)])
def test_a_number_is_the_hit_that_counts(hit: int, struck: bool) -> None:
    assert (run(f"worker.step=raise@{hit}").returncode == 1) is struck


def test_a_file_keeps_it_from_striking_again(tmp_path: Path) -> None:
    points = f"worker.step=kill@2;{tmp_path / 'died'}"
    assert run(points).returncode == -signal.SIGKILL
    assert (tmp_path / "died").exists()
    assert run(points).stdout == "alive\n"


def test_stop_stops_until_somebody_says_go_on(tmp_path: Path) -> None:
    code = "import os, meshdeform.support.failpoints as f; print(os.getpid(), flush=True); f.failpoint('worker.step')"
    environment = {**os.environ, "MESHDEFORM_FAILPOINTS": "worker.step=stop"}
    with subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE) as process:
        _pid, status = os.waitpid(process.pid, os.WUNTRACED)
        assert os.WIFSTOPPED(status)
        process.send_signal(signal.SIGCONT)
        assert process.wait(timeout=60) == 0


def test_a_pause_says_that_it_is_reached_and_waits_to_be_let_go(tmp_path: Path) -> None:
    gate = tmp_path / "gate"
    environment = {**os.environ, "MESHDEFORM_FAILPOINTS": f"worker.step=pause@2:{gate};{tmp_path / 'once'}"}
    with subprocess.Popen([sys.executable, "-c", TWICE], env=environment, stdout=subprocess.PIPE) as process:
        deadline = time.monotonic() + 60
        while not Path(f"{gate}.reached").exists():
            assert time.monotonic() < deadline
            time.sleep(0.005)
        assert process.poll() is None
        Path(f"{gate}.go").touch()
        assert process.communicate(timeout=60)[0] == b"alive\n"


@pytest.mark.parametrize(
    "text", ["worker.step", "worker.stepp=kill", "worker.step=die", "worker.step=pause", "worker.step=kill:f"]
)
def test_what_is_no_failpoint_is_refused(text: str) -> None:
    done = run(text)
    assert done.returncode == 1
    assert "is no failpoint" in done.stderr
