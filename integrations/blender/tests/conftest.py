"""Provide Blender as a module with the add-on, and a real service. Run by `scripts/test-blender`."""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed: scripts/test-blender installs it")
ROOT = Path(__file__).parents[3]
sys.path.insert(0, str(ROOT / "integrations/blender"))


@pytest.fixture(scope="session")
def server(pytestconfig: pytest.Config) -> Iterator[str]:
    """Start `meshdeform serve` in the project's own environment and yield its URL."""
    python = ROOT / ".venv/bin/python"
    with tempfile.TemporaryDirectory() as folder:
        command = [python, "-P", "-m", "meshdeform", "serve", "--port", "0", "--data-dir", folder]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert child.stdout is not None
        lines = []
        for line in child.stdout:
            lines.append(line)
            if found := re.search(r"http://\S+:\d+", line):
                break
        else:
            raise RuntimeError("".join(lines))
        drain = threading.Thread(target=lambda: [None for _ in child.stdout or ()])
        drain.start()
        yield found.group()
        child.terminate()
        child.wait(timeout=120)
        drain.join()
        child.stdout.close()


@pytest.fixture
def scene(server: str) -> Iterator[Any]:
    """Yield an empty scene in a Blender with the add-on enabled and set to the server."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _install()
    preferences = bpy.context.preferences.addons["meshdeform_blender"].preferences
    preferences.url = server
    yield bpy.context.scene
    with contextlib.suppress(Exception):
        bpy.ops.preferences.addon_disable(module="meshdeform_blender")


def _install() -> None:
    """Enable the package in place, as `Install from Disk` does with a copy."""
    import addon_utils

    module = addon_utils.enable("meshdeform_blender", default_set=True, handle_error=_raise)
    assert module is not None


def _raise(error: BaseException) -> None:
    raise error
