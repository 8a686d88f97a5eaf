"""Results go through the tools that come next, and what these write comes back to us: nothing gets lost on the way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.toolchain.assets import ASSETS, TRIANGLES
from tests.toolchain.conftest import Tool
from tests.toolchain.deformed import deformed

Counted = Callable[..., list[dict[str, Any]]]
Validate = Callable[[bytes], dict[str, Any]]
KEPT = ("triangles", "joints", "animations", "targets")
TUBES = {"rigged": 1, "morphing": 1, "scene": 7, "extended": 1}
OPTIMIZE = ("optimize", "--simplify", "false", "--compress")
TOOLS: dict[str, tuple[str, ...]] = {
    "optimize": ("gltf-transform", *OPTIMIZE, "meshopt"),
    "draco": ("gltf-transform", "draco"),
    "gltfpack": ("gltfpack", "-c", "-kn", "-ke", "-km"),
}
"""Input and output follow; of gltfpack as -i and -o."""
THROUGH = {"rigged": "optimize", "morphing": "gltfpack", "scene": "draco", "extended": "optimize"}


def through(tool: Tool, command: tuple[str, ...], source: Path, target: Path) -> Path:
    """Run a tool over a file."""
    name, *options = command
    if name == "gltfpack":
        tool(name, *options, "-i", source, "-o", target)
    else:
        tool(name, options[0], source, target, *options[1:])
    return target


def severe(report: dict[str, Any]) -> set[str]:
    return {issue["code"] for issue in report["issues"]["messages"] if issue["severity"] == 0}


@pytest.fixture(scope="module", params=list(ASSETS))
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `source.glb`, and the `result.glb` and `morph.glb` of its deformation."""
    folder = tmp_path_factory.mktemp(request.param)
    source = ASSETS[request.param]()
    (folder / "source.glb").write_bytes(source)
    (folder / "name").write_text(request.param)
    artifacts = deformed(source)
    for name in ("result.glb", "morph.glb"):
        (folder / name).write_bytes(artifacts[name])
    return folder


def test_results_are_valid_and_three_js_shows_what_it_showed_before(
    made: Path, counted: Counted, validate_glb: Validate
) -> None:
    source, result, morph = counted("three.mjs", *(made / name for name in ("source.glb", "result.glb", "morph.glb")))
    assert source["triangles"] == TUBES[(made / "name").read_text()] * TRIANGLES
    assert {**result, "box": source["box"]} == source
    assert not np.allclose(result["box"], source["box"], atol=1e-3)
    # Eight more targets on every mesh, one more clip with a track for each, and the same shape at rest.
    assert (morph["meshes"], morph["triangles"], morph["bones"]) == tuple(
        source[name] for name in ("meshes", "triangles", "bones")
    )
    assert morph["targets"] == source["targets"] + 8 * source["meshes"]
    assert morph["clips"] == [*source["clips"], "deform"]
    np.testing.assert_allclose(morph["box"], result["box"], atol=1e-5)
    for name in ("source.glb", "result.glb", "morph.glb"):
        assert severe(validate_glb((made / name).read_bytes())) == set(), name


def test_results_go_through_a_tool_and_keep_what_they_had(
    made: Path, node_tool: Tool, counted: Counted, validate_glb: Validate
) -> None:
    name = THROUGH[(made / "name").read_text()]
    # Draco is the slowest of the three, and writes both files in the same way: one is enough.
    inputs = [made / f"{which}.glb" for which in (["result"] if name == "draco" else ["result", "morph"])]
    outputs = [through(node_tool, TOOLS[name], path, path.with_suffix(f".{name}.glb")) for path in inputs]
    counts = counted("transform.mjs", *inputs, *outputs)
    for before, after, path in zip(counts, counts[len(inputs) :], outputs, strict=False):
        assert {key: after[key] for key in KEPT} == {key: before[key] for key in KEPT}, path.name
        assert severe(validate_glb(path.read_bytes())) == set(), path.name
    assert set(counts[-1]["extensions"]) & {"EXT_meshopt_compression", "KHR_draco_mesh_compression"}


INPUTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "gltfpack -c": ("rigged", ("gltfpack", "-c")),
    "gltfpack -cc": ("morphing", ("gltfpack", "-cc")),
    "gltf-transform meshopt": ("scene", ("gltf-transform", "meshopt")),
    "gltf-transform draco": ("scene", ("gltf-transform", "draco")),
    "gltf-transform quantize": ("extended", ("gltf-transform", "quantize")),
    "gltf-transform optimize": ("rigged", TOOLS["optimize"]),
}


@pytest.mark.parametrize("name", list(INPUTS))
def test_what_the_tools_write_is_deformed(
    name: str, tmp_path: Path, node_tool: Tool, counted: Counted, validate_glb: Validate
) -> None:
    asset, command = INPUTS[name]
    plain, packed, result = (tmp_path / file for file in ("plain.glb", "packed.glb", "result.glb"))
    plain.write_bytes(ASSETS[asset]())
    through(node_tool, command, plain, packed)
    before, there = load_asset(plain.read_bytes()).surface, load_asset(packed.read_bytes()).surface
    # Quantized, so no bit is the same, but the surface is.
    for bound in (np.min, np.max):
        np.testing.assert_allclose(bound(there.positions, axis=0), bound(before.positions, axis=0), atol=1e-3)
    result.write_bytes(deformed(packed.read_bytes())["result.glb"])
    counts = counted("transform.mjs", plain, packed, result)
    assert {key: counts[2][key] for key in KEPT} == {key: counts[1][key] for key in KEPT}
    assert counts[2]["triangles"] == counts[0]["triangles"]
    assert severe(validate_glb(result.read_bytes())) == set()
    (shown,) = counted("three.mjs", result)
    assert shown["triangles"] == counts[0]["triangles"]
