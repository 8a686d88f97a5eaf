"""The scripts can be started by a person and by CI."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest


def test_every_script_is_executable_strict_bash(repository: Path, subtests: pytest.Subtests) -> None:
    texts = {path: path.read_text() for path in [*(repository / "scripts").iterdir(), repository / ".ci/run"]}
    shell = {path: text for path, text in texts.items() if text.startswith("#!/usr/bin/env bash\n")}
    assert len(shell) > 5
    for path, text in shell.items():
        with subtests.test(path.name):
            assert os.access(path, os.X_OK)
            assert "set -euo pipefail" in text or "set -uo pipefail" in text
            subprocess.run(["bash", "-n", str(path)], check=True)


def test_setup_refuses_a_profile_that_does_not_exist(repository: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [repository / "scripts/setup", "everything"],
        env={**os.environ, "VENV": str(tmp_path / "venv")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "use run, serve or dev" in done.stderr
    assert not (tmp_path / "venv").exists()


def test_setup_says_which_python_it_needs(repository: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [repository / "scripts/setup"],
        env={**os.environ, "VENV": str(tmp_path / "venv"), "PYTHON": "/nonexistent/python"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "no Python 3.11 or newer found at /nonexistent/python" in done.stderr
