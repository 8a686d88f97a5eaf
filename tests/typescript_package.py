"""The TypeScript client, built as its package is: once for all tests, and again when its sources have changed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

__all__ = ["built_package"]

_MADE = shutil.ignore_patterns("node_modules", "dist", "schema.ts")


def built_package(repository: Path, folder: Path) -> Path:
    """Build a copy of the package, with the types of the committed OpenAPI document, and return its `dist`."""
    node, modules = shutil.which("node"), repository / "tests/node/node_modules"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not all((modules / name).is_dir() for name in ("openapi-typescript", "typescript")):
        pytest.skip("openapi-typescript is not installed (npm install --prefix tests/node)")
    sources = repository / "clients/typescript"
    built = modules / ".meshdeform-client" / _digest(repository, sources)
    if not built.is_dir():
        built.parent.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(dir=built.parent) as aside:
            package = Path(aside) / "package"
            shutil.copytree(sources, package, ignore=_MADE)
            (package / "node_modules").symlink_to(modules)
            for command in (
                [node, "generate.mjs", str(repository / "openapi/openapi.json"), "src/schema.ts"],
                [node, str(modules / "typescript/bin/tsc"), "-p", "tsconfig.json"],
            ):
                done = subprocess.run(command, cwd=package, capture_output=True, text=True, check=False, timeout=300)
                assert done.returncode == 0, done.stdout + done.stderr
            if not built.is_dir():  # another worker of the tests may have been faster
                with contextlib.suppress(OSError):
                    package.rename(built)
    return Path(shutil.copytree(built, folder / "package", symlinks=True)) / "dist"


def _digest(repository: Path, sources: Path) -> str:
    """Return a hash of all that the package is made of."""
    found = hashlib.sha256()
    for folder, names, files in os.walk(sources):
        left_out = _MADE(folder, [*names, *files])
        names[:] = sorted(set(names) - left_out)
        for name in sorted(set(files) - left_out):
            found.update(f"{Path(folder).relative_to(sources) / name}\0".encode())
            found.update((Path(folder) / name).read_bytes())
    for path in ("openapi/openapi.json", "tests/node/package.json"):
        found.update((repository / path).read_bytes())
    return found.hexdigest()
