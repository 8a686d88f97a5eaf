"""The judge: it knows members it never saw, and its answers do not depend on what they should not depend on."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from meshdeform.errors import ModelError, PromptError, ShapeError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.judge import WEIGHTS, Judge
from meshdeform.judge.scoring import draw_views, framed, judging_cameras
from meshdeform.vocabulary.nouns import NOUNS
from tests.cases import each_case
from training.judge.members import HELD_OUT, NOTHING, draw_shape, seeded, training_cameras
from training.prior.pictures import CAMERAS

SUITE = ["a vase", "a chair", "a giraffe", "a mushroom", "a car", "a star", "a rabbit", "a table", "a whale", "a lamp"]


def shown(noun: str, number: int) -> TriangleMesh:
    """A shape by other code, from the range of seeds that nothing was trained with."""
    kind = f"other {noun}"
    shape = draw_shape(kind, seeded(HELD_OUT, kind, 1000 + number))
    return TriangleMesh(shape.verts, shape.faces)


def turned(mesh: TriangleMesh, degrees: float) -> TriangleMesh:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return TriangleMesh(mesh.verts @ turn.T, mesh.faces)


@pytest.fixture(scope="module")
def judge() -> Judge:
    return Judge()


def test_it_knows_every_noun(judge: Judge) -> None:
    assert judge.nouns == tuple(NOUNS)


def test_retrieval_of_plain_prompts_in_a_suite(judge: Judge) -> None:
    right = [
        int(judge.log_likelihoods(shown(prompt.split()[1], number), SUITE).argmax()) == row
        for row, prompt in enumerate(SUITE)
        for number in range(2)
    ]
    assert sum(right) >= 18


def test_size_place_stray_vertices_and_other_words_for_the_same_do_not_matter(judge: Judge) -> None:
    mesh = shown("rabbit", 0)
    same = judge.log_likelihoods(mesh, ["a bunny", "The HARE that has a big ear"])
    assert same[0] == same[1]
    moved = TriangleMesh(np.concatenate([mesh.verts * 0.037 + [3.0, -7.0, 11.0], [[500.0, 0.0, 0.0]]]), mesh.faces)
    np.testing.assert_allclose(framed(moved)[:-1], framed(mesh), atol=1e-12)
    np.testing.assert_allclose(judge.log_likelihoods(moved, SUITE), judge.log_likelihoods(mesh, SUITE), atol=1e-2)


@each_case("noun", ["giraffe", "chair", "whale"])
def test_a_quarter_turn_only_permutes_the_views(judge: Judge, noun: str) -> None:
    mesh = shown(noun, 1)
    straight, quarter = judge.log_likelihoods(mesh, SUITE), judge.log_likelihoods(turned(mesh, 90.0), SUITE)
    np.testing.assert_array_equal(straight.argsort(), quarter.argsort())
    np.testing.assert_allclose(straight, quarter, atol=0.2)


def test_a_ball_is_nothing_for_certain(judge: Judge) -> None:
    assert max(judge.noun_probabilities(icosphere(3)).values()) < 0.5


def test_of_public_assets_common_nouns_are_likelier(judge: Judge) -> None:
    mesh = icosphere(2)
    alike, common = judge.noun_probabilities(mesh), judge.noun_probabilities(mesh, of_public=True)
    assert sum(common.values()) == pytest.approx(1.0, abs=1e-5)
    # Chairs are in 53 packs, benches in 31, both are among the first nouns, and nobody has a mermaid in several packs.
    ratio = {noun: common[noun] / alike[noun] for noun in ("chair", "bench", "mermaid")}
    assert ratio["chair"] / ratio["mermaid"] == pytest.approx(math.e * 53**0.5, rel=0.01)
    assert ratio["chair"] / ratio["bench"] == pytest.approx((53 / 31) ** 0.5, rel=0.01)


def test_the_views_are_not_the_priors() -> None:
    judging, drawn = judging_cameras(), training_cameras(seeded(0, NOTHING, 0))
    assert sum(e < CAMERAS.elevation_min_deg for e in judging.elevation_deg) == 4
    assert sum(e > CAMERAS.elevation_max_deg for e in judging.elevation_deg) == 4
    for cameras in (judging, drawn):
        assert cameras.fov_deg < CAMERAS.fov_min_deg
        assert not any(CAMERAS.elevation_min_deg <= e <= CAMERAS.elevation_max_deg for e in cameras.elevation_deg)


def test_the_surface_is_darker_than_the_background() -> None:
    images = draw_views(icosphere(3), judging_cameras())
    assert images.shape == (8, 64, 64)
    assert (images[:, 0, 0] == 1).all()
    # The light comes from the upper left: lit clay is 0, clay in shade 0.75.
    assert images[:, 26:30, 26:30].max() < 0.3
    assert images[0, 45, 45] > images[0, 18, 22] + 0.2


def test_identity_names_the_file(judge: Judge) -> None:
    assert set(judge.identity) == {"id", "revision", "sha256"}
    assert judge.identity["sha256"] == hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()
    assert WEIGHTS.stat().st_size <= 3_000_000


def test_bad_input_is_refused(judge: Judge) -> None:
    with pytest.raises(VocabularyError):
        judge.log_likelihoods(icosphere(1), ["a pulpit"])
    with pytest.raises(PromptError):
        judge.log_likelihoods(icosphere(1), [""])
    point = TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    nothing = TriangleMesh(np.ones((3, 3)), np.zeros((0, 3), np.int64))
    infinite = TriangleMesh(np.full((3, 3), math.inf), np.array([[0, 1, 2]]))
    for mesh in (point, nothing, infinite):
        with pytest.raises(ShapeError):
            judge.noun_probabilities(mesh)


def rewritten(path: Path, *, metadata: dict[str, str] | None = None, without: str = "") -> Path:
    """The shipped weights with other metadata, or without a tensor."""
    with safe_open(WEIGHTS, framework="np") as file:
        held = {**file.metadata(), **(metadata or {})}
        state = {name: file.get_tensor(name) for name in file.keys() if name != without}  # noqa: SIM118
    save_file(state, path, held)
    return path


def _config(**changes: object) -> str:
    with safe_open(WEIGHTS, framework="np") as file:
        return json.dumps({**json.loads(file.metadata()["config"]), **changes})


def test_foreign_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="missing"):
        Judge(tmp_path / "none.safetensors")
    (tmp_path / "torn").write_bytes(WEIGHTS.read_bytes()[:5000])
    with pytest.raises(ModelError, match="cannot be read"):
        Judge(tmp_path / "torn")
    with pytest.raises(ModelError, match="another network"):
        Judge(rewritten(tmp_path / "fewer", metadata={"config": _config(nouns=["cat", "dog"])}))
    with pytest.raises(ModelError, match="another network"):
        Judge(rewritten(tmp_path / "lacking", without="noun_head.weight"))
    with pytest.raises(ModelError, match="another network"):
        Judge(rewritten(tmp_path / "wider", metadata={"config": _config(stem=32)}))
    assert np.isfinite(Judge(rewritten(tmp_path / "same")).log_likelihoods(icosphere(2), SUITE)).all()
