"""The health check of a worker's container: quick, without torch, and red when the supervisor is silent."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from meshdeform.settings import Settings
from worker.health import SignOfLife

CHECK = [sys.executable, "-m", "worker.health"]


def check(folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MESHDEFORM_DATA_DIR": str(folder)}
    return subprocess.run(CHECK, env=environment, capture_output=True, text=True, timeout=60)


def test_it_is_green_while_the_supervisor_lives(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    assert (check(folder).returncode, check(folder).stderr) == (1, "no supervisor has run here\n")
    with SignOfLife(Settings(data_dir=folder)):
        assert check(folder).returncode == 0
        (sign,) = folder.iterdir()
        past = time.time() - 100.0
        os.utime(sign, (past, past))
        done = check(folder)
        assert done.returncode == 1
        assert "the supervisor is silent" in done.stderr
    assert check(folder).returncode == 1


def test_a_folder_that_cannot_be_written_stops_no_supervisor(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()
    with SignOfLife(Settings(data_dir=tmp_path / "file" / "data")) as sign:
        sign.give()
    assert caplog.text.count("health checks will not see this worker") == 1


def test_it_loads_nothing_heavy() -> None:
    code = "import sys, worker.health; print({'torch', 'numpy', 'sqlalchemy', 'redis'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"
