"""Test that Blender itself accepts and installs the archive."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).parents[3]
INSTALL = """
import sys, bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
name = "bl_ext.user_default.meshdeform_blender"
assert bpy.context.preferences.addons[name].preferences.url == "http://127.0.0.1:8765"
assert bpy.context.scene.meshdeform.apply == "SHAPE_KEY"
bpy.ops.mesh.primitive_cube_add()
try:
    bpy.context.preferences.addons[name].preferences.url = "nonsense"
    bpy.ops.meshdeform.deform()
except RuntimeError as error:
    assert "not the address of a service" in str(error)
else:
    raise AssertionError("no error was raised")
print("installed")
"""


@pytest.fixture(scope="module")
def archive() -> str:
    built = subprocess.run([ROOT / "integrations/blender/build"], check=True, capture_output=True, text=True)
    return built.stdout.strip()


def test_blenders_own_check_has_no_complaint(archive: str) -> None:
    scripts = Path(bpy.utils.resource_path("LOCAL")) / "scripts"
    check = next(scripts.rglob("blender_ext.py"))
    done = subprocess.run([sys.executable, check, "validate", archive], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "FATAL" not in done.stdout + done.stderr
    assert "WARN" not in done.stdout + done.stderr


def test_blender_installs_and_enables_it(archive: str, tmp_path: Path) -> None:
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path)}
    command = [sys.executable, "-c", INSTALL, archive]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.endswith("installed\n"), done.stdout + done.stderr
