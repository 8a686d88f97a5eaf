"""Several hosts: a worker whose cable is pulled loses its job to another one."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.acceptance.cluster import ROOT
from tests.acceptance.several_hosts import NOT_INSTALLED

pytestmark = pytest.mark.acceptance


@pytest.mark.timeout(600)
def test_a_worker_host_that_is_cut_off_loses_its_job_to_the_other(tmp_path: Path, server_folder: Path) -> None:
    servers = server_folder / f"hosts-{time.time_ns()}"
    command = [sys.executable, "-m", "tests.acceptance.several_hosts", str(tmp_path), str(servers)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if run.returncode == NOT_INSTALLED:
        pytest.skip(run.stderr.strip())
    assert run.returncode == 0, run.stderr
