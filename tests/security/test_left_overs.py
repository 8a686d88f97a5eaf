"""Kill the API while it receives files: the next one removes what is left, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from meshdeform.settings import Settings
from service.state import AppState
from service.workspace import Workspace

KILLED = """
import os
from service.workspace import Workspace
workspace = Workspace()
with workspace.temporary_folder() as folder:
    (folder / "asset").write_bytes(b"x" * 1000)
    print(workspace.folder, flush=True)
    os.kill(os.getpid(), 9)
"""


def test_files_of_a_killed_process_are_removed_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    alive = Workspace()
    killed = subprocess.run(
        [sys.executable, "-c", KILLED], env={"TMPDIR": str(tmp_path)}, capture_output=True, text=True, check=False
    )
    assert killed.returncode == -9, killed.stderr
    left = Path(killed.stdout.strip())
    assert list(left.glob("*/asset"))
    others = tmp_path / "meshdeform-api-of-somebody"
    others.mkdir()
    (tmp_path / "meshdeform-api-link").symlink_to(others)

    state = AppState.open(Settings(data_dir=tmp_path / "data", redis_url="redis://127.0.0.1:1"))
    assert not left.exists()
    assert alive.folder.is_dir(), "another process uses it"
    assert others.is_dir()
    with state.workspace.temporary_folder() as folder:
        assert folder.parent == state.workspace.folder
    assert not folder.exists()
    state.close()
    alive.close()
    assert sorted(path.name for path in tmp_path.glob("meshdeform-api-*")) == [
        "meshdeform-api-link",
        "meshdeform-api-of-somebody",
    ]
