"""hadolint finds nothing in the Dockerfiles, not even a remark."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.cases import each_case


@pytest.fixture(scope="module")
def hadolint(repository: Path) -> str:
    found = sorted((repository / "tests/.hadolint").glob("*/bin/hadolint"))
    program = str(found[-1]) if found else shutil.which("hadolint")
    if program is None:
        pytest.skip("hadolint is not installed (scripts/test installs it)")
    return program


@each_case("name", ["service", "worker"])
def test_nothing_is_found(hadolint: str, repository: Path, name: str) -> None:
    path = repository / f"docker/{name}.Dockerfile"
    done = subprocess.run([hadolint, "--no-color", str(path)], capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)
