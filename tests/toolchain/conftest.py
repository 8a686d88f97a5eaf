"""What the tests of other people's tools share: the tools, the service, the add-on's modules."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "integrations/blender"))

Tool = Callable[..., str]


@pytest.fixture(scope="session")
def node_tool(repository: Path) -> Tool:
    """Run `node_tool("gltf-transform", ...)`, or any other program of tests/node; its output."""
    node, modules = shutil.which("node"), repository / "tests/node/node_modules"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not all((modules / name).exists() for name in ("@gltf-transform/cli", "gltfpack", "three")):
        pytest.skip("glTF-Transform, gltfpack and three.js are not installed (npm install --prefix tests/node)")

    def run(name: str, *arguments: str | Path) -> str:
        command = [node, modules / ".bin" / name, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)
        assert done.returncode == 0, f"{name} {arguments}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def counted(node_tool: Tool, repository: Path) -> Iterator[Callable[..., list[dict[str, Any]]]]:
    """Count what is in GLBs with `counted("three.mjs", path, ...)` or `counted("transform.mjs", path, ...)`."""
    node = shutil.which("node")
    assert node is not None  # else `node_tool` has skipped
    # One process of each script for all files: starting it takes many times as long as a file.
    with ExitStack() as running:

        @cache
        def started(script: str) -> subprocess.Popen[str]:
            command = [node, repository / "tests/node" / script]
            return running.enter_context(
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            )

        def count(script: str, *paths: Path) -> list[dict[str, Any]]:
            requests, answers = started(script).stdin, started(script).stdout
            assert requests is not None
            assert answers is not None
            print(json.dumps([str(path) for path in paths]), file=requests, flush=True)
            found = json.loads(answers.readline())
            assert isinstance(found, list), found
            return found

        yield count
