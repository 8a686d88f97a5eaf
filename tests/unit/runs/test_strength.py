"""Strengths of a result: exact bytes at 0 and 1, everything else of the file kept, and the way as a morph."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.errors import ParameterError
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.requests.choices import Easing
from meshdeform.requests.document import MorphParams
from meshdeform.runs.strength import AssetPath, edit_of, with_edit, with_strength, write_morph
from tests.cases import each_case
from tests.unit.assets.builders import Builder, unpack
from tests.unit.assets.playing import Player
from tests.unit.assets.test_replace import accessor, position
from tests.unit.assets.test_rig import TURN, arm
from training.shapes import cylinder

BAR = cylinder(0.25, 4.0, 16, 32)
TWO = join(icosphere(2), BAR)


def bent(points: NDArray[np.float64], degrees: float = 120.0) -> NDArray[np.float64]:
    radius = 4.0 / math.radians(degrees)
    angle, arm = (points[:, 1] + 2) / radius, radius - points[:, 0]
    return np.stack([radius - arm * np.cos(angle), arm * np.sin(angle) - 2, points[:, 2]], 1)


def made(mesh: object = BAR) -> tuple[Asset, bytes]:
    """Return an asset with normals, and its result."""
    source = load_asset(build_glb(mesh.verts, mesh.faces))  # type: ignore[attr-defined]
    result = source.replace(bent(source.surface.positions), provenance={"seed": 7})
    return source, result


@each_case("mesh", [BAR, TWO])
def test_zero_has_the_positions_of_the_source_and_one_is_the_result(mesh: object) -> None:
    source, result = made(mesh)
    assert with_strength(source, result, 1.0) == result
    at_rest = with_strength(source, result, 0.0)
    assert position(at_rest).tobytes() == position(source.to_bytes()).tobytes()
    near = AssetPath(source, load_asset(result).surface.positions).at(1 - 1e-9)
    np.testing.assert_allclose(near.positions, load_asset(result).surface.positions, atol=1e-6)


def test_a_strength_bends_by_that_share_and_says_so() -> None:
    source, result = made()
    half = load_asset(with_strength(source, result, 0.5))
    np.testing.assert_allclose(half.surface.positions, bent(source.surface.positions, 60.0), atol=0.012)
    assert half.provenance == {"seed": 7, "strength": 0.5}
    exaggerated = load_asset(with_strength(source, result, 1.5, compact=True))
    np.testing.assert_allclose(exaggerated.surface.positions, bent(source.surface.positions, 180.0), atol=0.05)


def test_a_subdivided_run_and_one_that_left_out_nodes() -> None:
    coarse = cylinder(0.25, 4.0, 8, 1)
    asset = load_asset(build_glb(coarse.verts, coarse.faces))
    source, _ = asset.subdivided(10_000)
    assert len(source.surface.triangles) > len(asset.surface.triangles)
    result = source.replace(bent(source.surface.positions))
    half = load_asset(with_strength(asset, result, 0.5)).surface
    np.testing.assert_allclose(half.positions, bent(source.surface.positions, 60.0), atol=0.1)
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh, name="kept")
    builder.node(mesh, translation=[5, 0, 0])
    whole = load_asset(builder.glb())
    moved = whole.without([0])
    result = moved.replace(moved.surface.positions + [0.0, 2.0, 0.0])
    shown = load_asset(with_strength(whole, result, 0.5, exclude=["kept"])).surface.positions
    expected = whole.surface.positions + np.repeat([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 4, axis=0)
    np.testing.assert_allclose(shown, expected, atol=1e-6)


def test_another_asset_and_a_strength_out_of_range_are_refused() -> None:
    source, _ = made()
    _, other = made(TWO)
    with pytest.raises(ParameterError, match="was not made from"):
        with_strength(source, other, 0.5)
    with pytest.raises(ParameterError, match="is not between 0 and"):
        with_strength(source, other, 1.6)


def test_a_morph_goes_through_the_shapes_of_the_path() -> None:
    source, result = made()
    path = AssetPath(source, load_asset(result).surface.positions)
    way = MorphParams(frames=4, easing=Easing.SMOOTH, ping_pong=True, seconds=2.0)
    root, binary, _ = unpack(write_morph(source, path, path.at(1), way))
    mesh = root["meshes"][0]
    assert mesh["extras"]["targetNames"] == ["deform 1/4", "deform 2/4", "deform 3/4", "deform"]
    assert mesh["weights"] == [0, 0, 0, 1]
    base = source.surface.positions
    for number, target in enumerate(mesh["primitives"][0]["targets"], 1):
        shown = base + accessor(root, binary, target["POSITION"])
        np.testing.assert_allclose(shown, path.at(number / 4).positions, atol=1e-6)
    (animation,) = root["animations"]
    (sampler,) = animation["samplers"]
    times = accessor(root, binary, sampler["input"]).reshape(-1)
    weights = accessor(root, binary, sampler["output"]).reshape(-1, 4)
    np.testing.assert_allclose(times[[0, 2, 4, 6, 8]], [0.0, 1.0, 2.0, 3.0, 4.0], atol=1e-6)
    np.testing.assert_allclose(weights.argmax(1), [0, 0, 1, 2, 3, 2, 1, 0, 0])
    np.testing.assert_allclose(weights.sum(1), [0, 1, 1, 1, 1, 1, 1, 1, 0])
    # Smooth: 3 u^2 - 2 u^3 of the time is the share of the way.
    u = times[1] / 2
    assert 3 * u**2 - 2 * u**3 == pytest.approx(0.25, abs=1e-6)


def fatter(source: Asset) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions that are wider the higher they are, and the Jacobians."""
    at = source.surface.positions
    width = 1.5 + 0.2 * at[:, 1]
    jacobians = np.tile(np.eye(3), (len(at), 1, 1))
    jacobians[:, 0, 0] = jacobians[:, 2, 2] = width
    jacobians[:, 0, 1], jacobians[:, 2, 1] = 0.2 * at[:, 0], 0.2 * at[:, 2]
    return at * np.column_stack([width, 0 * width + 1.25, width]), jacobians


def test_a_character_whose_joints_stand_in_another_pose_has_strengths_in_one_place() -> None:
    builder = arm()
    builder.root["nodes"][4]["rotation"], builder.root["nodes"][4]["translation"] = TURN, [0.4, 0.75, 0.1]
    source = load_asset(builder.glb())
    positions, jacobians = fatter(source)
    result = source.replace(positions, jacobians=jacobians)
    near = with_strength(source, result, 0.999)
    np.testing.assert_allclose(load_asset(near).surface.positions, load_asset(result).surface.positions, atol=0.01)


def test_clothes_move_with_the_joints_of_the_body() -> None:
    named, sleeve = arm(), arm()
    for builder in (named, sleeve):
        for number, node in enumerate(builder.root["nodes"]):
            node["name"] = f"joint {number}"
    # Only the lower half, whose own triangles know nothing of the last joint.
    sleeve.root["accessors"][sleeve.root["meshes"][0]["primitives"][0]["indices"]]["count"] //= 2
    body = load_asset(named.glb())
    positions, _ = fatter(body)
    result = body.replace(positions, jacobians=AssetPath(body, positions).jacobians(1))
    clothes = with_edit(load_asset(sleeve.glb()), edit_of(body, result))
    for time in (None, 0.0, 0.4, 1.0):
        of_body, of_clothes = (Player(glb).worlds(time) for glb in (result, clothes))
        for joint in named.root["skins"][0]["joints"]:
            np.testing.assert_allclose(of_clothes[joint], of_body[joint], atol=1e-5)


def test_a_rig_that_stayed_stays_in_other_files_too() -> None:
    body = load_asset(arm().glb())
    positions, _ = fatter(body)
    clothes = load_asset(with_edit(body, edit_of(body, body.replace(positions))))
    assert clothes.rig_digest() == body.rig_digest()
    np.testing.assert_allclose(clothes.surface.positions, positions, atol=0.02)


def test_a_rig_that_stayed_stays_at_every_strength() -> None:
    source = load_asset(arm().glb())
    positions, jacobians = fatter(source)
    for kept in (True, False):
        result = source.replace(positions, jacobians=None if kept else jacobians)
        half = load_asset(with_strength(source, result, 0.5))
        assert (half.rig_digest() == source.rig_digest()) is kept
