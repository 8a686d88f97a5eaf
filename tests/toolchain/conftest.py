"""What the tests of other people's tools share: the tools, the service, the add-on's modules."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "integrations/blender"))

Tool = Callable[..., str]


@pytest.fixture(scope="session")
def node_tool(repository: Path) -> Tool:
    """Run `node_tool("gltf-transform", ...)`, a script of tests/toolchain, or any other of tests/node; its output."""
    node, modules = shutil.which("node"), repository / "tests/node/node_modules"
    if node is None:
        pytest.skip("Node.js is not installed (apt install nodejs npm, then scripts/test)")
    if not all((modules / name).exists() for name in ("@gltf-transform/cli", "gltfpack", "three")):
        pytest.skip("glTF-Transform, gltfpack and three.js are not installed (npm install --prefix tests/node)")

    def run(name: str, *arguments: str | Path) -> str:
        program = repository / "tests/node" / name if name.endswith(".mjs") else modules / ".bin" / name
        done = subprocess.run([node, program, *arguments], capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, f"{name} {arguments}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def counted(node_tool: Tool) -> Callable[..., list[dict[str, Any]]]:
    """Count what is in GLBs with `counted("three.mjs", path, ...)` or `counted("transform.mjs", path, ...)`."""
    return lambda script, *paths: json.loads(node_tool(script, *paths))
