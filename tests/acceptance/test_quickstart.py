"""The commands of docs/quickstart.md, run in the order of the page against a real service."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.acceptance.service import Service, smaller

pytestmark = pytest.mark.acceptance

ADDRESS = "http://127.0.0.1:8765"


def blocks(page: str) -> list[tuple[str, str]]:
    """The blocks that are marked to be run, with their languages."""
    return re.findall(r"^<!-- run -->\n```(sh|python)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


@pytest.mark.slow
def test_the_quickstart_runs_as_written(service: Service, repository: Path, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(repository / "examples")
    url = str(service.http.base_url).rstrip("/")
    environment = {
        **os.environ,
        **smaller(),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "MESHDEFORM_URL": url,
    }
    found = blocks((repository / "docs/quickstart.md").read_text())
    assert [language for language, _ in found] == ["sh", "sh", "sh", "python"]
    for language, written in found:
        text = written.replace(ADDRESS, url)
        command = ["bash", "-euo", "pipefail", "-c"] if language == "sh" else [sys.executable, "-c"]
        done = subprocess.run(
            [*command, text],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}\n{service.log}"
    for name in ("vase.glb", "vase.preview.png", "mushroom.glb"):
        assert (tmp_path / name).stat().st_size > 1000, name
    assert len(list((tmp_path / "results").rglob("result.glb"))) == 1
    assert len(list((tmp_path / "snowman").rglob("result.glb"))) == 1
