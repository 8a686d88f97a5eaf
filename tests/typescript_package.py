"""The TypeScript client, built as its package is: once for all tests, and again when its sources have changed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tarfile
import tempfile
from pathlib import Path

import pytest

from release.typescript import packed

__all__ = ["built_package"]

_MADE = shutil.ignore_patterns("node_modules", "dist", "schema.ts")


def built_package(repository: Path, folder: Path) -> Path:
    """Pack the client as a release does, with the types of the committed OpenAPI document, and return its `dist`."""
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
            with tarfile.open(packed(Path(aside))) as archive:
                archive.extractall(aside, filter="data")
            package = Path(aside) / "package"
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
    for path in ("openapi/openapi.json", "tests/node/package.json", "release/typescript.py"):
        found.update((repository / path).read_bytes())
    return found.hexdigest()
