"""The assets under examples/ are what examples/generate.py makes, and closed surfaces once they are welded."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.geometry.weld import weld
from tests.cases import each_case

NAMES = ["capsule", "cube", "sphere", "vase"]


@pytest.fixture(scope="module")
def generate(repository: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate_examples", repository / "examples/generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks there
    spec.loader.exec_module(module)
    assert sorted(path.stem for path in (repository / "examples").glob("*.glb")) == sorted(module.EXAMPLES) == NAMES
    return module


@each_case("name", NAMES)
def test_an_example_is_what_the_script_makes_valid_closed_and_faces_outwards(
    name: str, generate: ModuleType, repository: Path, validate_glb: Callable[[bytes], dict[str, Any]]
) -> None:
    data = (repository / f"examples/{name}.glb").read_bytes()
    report = validate_glb(data)
    # The UVs wait for the user's texture.
    assert {message["code"] for message in report["issues"]["messages"]} <= {"UNUSED_OBJECT"}
    assert report["issues"]["numErrors"] == 0
    # Not the bytes: sines differ in the last place from one processor to the next.
    surface, made = load_asset(data).surface, load_asset(generate.glb(name)).surface
    np.testing.assert_array_equal(surface.triangles, made.triangles)
    np.testing.assert_allclose(surface.positions, made.positions, atol=1e-6)
    np.testing.assert_allclose(surface.normals, made.normals, atol=1e-6)
    welded = weld(surface.positions, surface.triangles)
    assert set(welded.skipped.values()) == {0}
    corners = surface.positions[surface.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("ij,ij->", corners[:, 0], cross) > 0
    assert (np.einsum("ij,ikj->ik", cross, surface.normals[surface.triangles]) > 0).all()
    assert len(welded.mesh.verts) < len(surface.positions)
