"""Test results converted to USDZ by Blender with Pixar's own library and validators."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from files_seen import FOLDER, document, triangles

SCRIPT = Path(__file__).parents[1] / "to_usdz.py"
# In a separate process, because Blender contains a USD library and two in one process conflict.
LOOK = Path(__file__).with_name("look_at_usd.py")
NAMES = sorted(path.stem for path in FOLDER.glob("*-result.glb")) if os.environ.get("MESHDEFORM_RESULTS") else []


@pytest.fixture(scope="module", params=NAMES)
def seen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any]]:
    """Return the name of a result, and the summary of its USDZ."""
    target = tmp_path_factory.mktemp(request.param) / "result.usdz"
    subprocess.run([sys.executable, SCRIPT, FOLDER / f"{request.param}.glb", target], check=True, capture_output=True)
    done = subprocess.run([sys.executable, LOOK, target], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return request.param, json.loads(done.stdout)


def test_pixars_validators_find_nothing(seen: tuple[str, dict[str, Any]]) -> None:
    assert seen[1]["validators"] > 10
    assert seen[1]["errors"] == []


def test_everything_is_there_in_metres_with_y_up(seen: tuple[str, dict[str, Any]]) -> None:
    name, found = seen
    root = document(FOLDER / f"{name}.glb")
    assert (found["up"], found["unit"], found["root"]) == ("Y", 1.0, "/root")
    assert found["meshes"] == sum("mesh" in node for node in root["nodes"])
    assert found["triangles"] == triangles(root)
    assert found["normals"]
    assert found["uvs"]
    assert found["materials"]
    assert found["textures"] >= 1
    assert found["found"]
    bones = [len(skin["joints"]) for skin in root.get("skins", [])]
    assert found["joints"] == (bones or found["joints"])
    assert found["moves"] == bool(root.get("animations"))
    assert found["shapes"] == sum(len(p.get("targets", [])) for mesh in root["meshes"] for p in mesh["primitives"])
    if name == "extended-result":  # without transforms, skin and weights the bounds are those in the file
        (primitive,) = root["meshes"][0]["primitives"]
        accessor = root["accessors"][primitive["attributes"]["POSITION"]]
        for mine, theirs in zip(found["box"], (accessor["min"], accessor["max"]), strict=True):
            assert mine == pytest.approx(theirs, abs=1e-4)
