"""The TypeScript client as its package has it."""

from __future__ import annotations

import shutil
import tarfile
from pathlib import Path

import pytest

from release.typescript import packed

__all__ = ["built_package"]


def built_package(repository: Path, folder: Path) -> Path:
    """Pack the client as a release does, and return the `dist` that is in its package."""
    node, modules = shutil.which("node"), repository / "tests/node/node_modules"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not all((modules / name).is_dir() for name in ("openapi-typescript", "typescript")):
        pytest.skip("openapi-typescript is not installed (npm install --prefix tests/node)")
    folder.mkdir(parents=True, exist_ok=True)
    with tarfile.open(packed(folder)) as archive:
        archive.extractall(folder, filter="data")
    return folder / "package/dist"
