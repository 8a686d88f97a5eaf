"""The benchmark's sources are what their table says, and its suites are whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh, edges_of, face_cross
from tests.cases import each_case
from training.evaluation.sources import SOURCES, source_mesh
from training.evaluation.suite import ASSET_PAIRS, SUITES, files_in

pytestmark = pytest.mark.training


def volume(mesh: TriangleMesh) -> float:
    return float((mesh.verts[mesh.faces[:, 0]] * face_cross(mesh.verts, mesh.faces)).sum() / 6)


@each_case("name", SOURCES)
def test_sources_are_closed_consistently_oriented_outwards_and_of_the_promised_size(name: str) -> None:
    mesh = source_mesh(name)
    edges = edges_of(mesh.faces)
    assert 1_500 <= len(mesh.faces) <= 2_600
    assert bool((edges.counts == 2).all())
    assert bool(edges.consistent.all())
    assert volume(mesh) > 0


@each_case(("name", "count"), [("small", 48), ("full", 192), ("nouns", 149), ("assets", 16), ("paper", 48)])
def test_a_suite_has_every_item_once_and_each_prompt_early(name: str, count: int) -> None:
    suite = SUITES[name]
    assert len({item.name for item in suite.items}) == len(suite.items) == count
    if not suite.of_files:
        assert {source for source, _ in suite.pairs} <= set(SOURCES)
        assert {prompt for _, prompt in suite.pairs[: len(suite.prompts)]} == set(suite.prompts)


def test_files_are_found_anywhere_in_a_folder_and_what_is_missing_is_named(tmp_path: Path) -> None:
    for name, _ in ASSET_PAIRS:
        (tmp_path / "deep" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "deep" / name).touch()
    assert files_in(tmp_path, SUITES["assets"].items)["spot.obj"] == tmp_path / "deep" / "spot.obj"
    (tmp_path / "deep" / "spot.obj").unlink()
    with pytest.raises(ParameterError, match=r"has no spot\.obj\."):
        files_in(tmp_path, SUITES["assets"].items)
