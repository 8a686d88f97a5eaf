"""The TypeScript client, built as its package is."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

__all__ = ["built_package"]


def built_package(repository: Path, folder: Path) -> Path:
    """Build a copy of the package, with the types of the committed OpenAPI document, and return its `dist`."""
    node, modules = shutil.which("node"), repository / "tests/node/node_modules"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not all((modules / name).is_dir() for name in ("openapi-typescript", "typescript")):
        pytest.skip("openapi-typescript is not installed (npm install --prefix tests/node)")
    package = folder / "package"
    shutil.copytree(
        repository / "clients/typescript", package, ignore=shutil.ignore_patterns("node_modules", "dist", "schema.ts")
    )
    (package / "node_modules").symlink_to(modules)
    for command in (
        [node, "generate.mjs", str(repository / "openapi/openapi.json"), "src/schema.ts"],
        [node, str(modules / "typescript/bin/tsc"), "-p", "tsconfig.json"],
    ):
        done = subprocess.run(command, cwd=package, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
    return package / "dist"
