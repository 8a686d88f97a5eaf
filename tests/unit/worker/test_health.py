"""The health check of a worker's container: quick, without torch, and red when no supervisor lives."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from meshdeform.settings import Settings
from worker.health import sign_of_life

CHECK = [sys.executable, "-m", "worker.health"]
SUPERVISOR = """
from meshdeform.settings import Settings
from worker.health import sign_of_life
with sign_of_life(Settings()):
    print("here", flush=True)
    input()
"""


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MESHDEFORM_DATA_DIR": str(folder)}
    return subprocess.run(CHECK, env=environment, capture_output=True, text=True, timeout=60)


def test_it_is_green_while_a_supervisor_lives(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    before = check(folder)
    assert (before.returncode, before.stderr) == (1, "no supervisor has run here\n")
    with sign_of_life(Settings(data_dir=folder)):
        with sign_of_life(Settings(data_dir=folder)):
            assert check(folder).returncode == 0
        assert check(folder).returncode == 0
    after = check(folder)
    assert (after.returncode, after.stderr) == (1, "the supervisor has ended\n")


def test_it_is_red_after_a_supervisor_was_killed(tmp_path: Path) -> None:
    environment = {**os.environ, "MESHDEFORM_DATA_DIR": str(tmp_path)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SUPERVISOR], env=environment, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == b"here\n"
        assert check(tmp_path).returncode == 0
        process.send_signal(signal.SIGKILL)
    assert check(tmp_path).returncode == 1


def test_a_folder_that_cannot_be_written_stops_no_supervisor(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    with sign_of_life(Settings(data_dir=tmp_path / "file" / "data")):
        pass
    assert caplog.text.count("health checks will not find this worker") == 1


def test_it_loads_nothing_heavy() -> None:
    code = "import sys, worker.health; print({'torch', 'numpy', 'sqlalchemy', 'redis'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"
