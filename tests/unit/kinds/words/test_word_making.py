"""Words are made of meshes: their parts, their front, their size, and what is wrong with files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import Limits, Primitive, build_glb
from meshdeform.errors import AssetEmptyError, AssetError, ParameterError
from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.words import making
from meshdeform.kinds.words.making import make_word
from meshdeform.kinds.words.process import made_word
from meshdeform.nouns.forms import drawn
from meshdeform.reading import banks
from meshdeform.reading.choice import facing
from meshdeform.runs.kept_readings import Unkept
from meshdeform.words import MAX_FACES, Word, WordOffer

COW = drawn("cow", (), np.random.default_rng(4))
GUANACO = WordOffer("guanaco", like="cow", licence="CC0")
POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FLAT = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"


@pytest.fixture(scope="module")
def readings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Unkept]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(banks, "MEMBERS", 16)  # which are drawn in a seventh of the time
        banks._bank_of.cache_clear()
        yield Unkept(tmp_path_factory.mktemp("samples"))
    banks._bank_of.cache_clear()


@pytest.fixture
def _unread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no reading find anything, which takes time."""
    monkeypatch.setattr("meshdeform.kinds.words.making.read_source", lambda *_, **__: None)


def cow(turn_deg: float = 0.0, scale: float = 3.0) -> bytes:
    return build_glb(scale * COW.verts @ facing(-turn_deg).T + [5.0, 1.0, 0.0], COW.faces)


def arrow(turn_deg: float = 0.0, scale: float = 3.0) -> bytes:
    mesh = icosphere(2)
    verts = mesh.verts * [1.0, 0.5, 2.0]
    verts[:, 0] *= np.where(verts[:, 2] > 0, 1 - verts[:, 2] / 2, 1.0)
    return build_glb(scale * verts @ facing(-turn_deg).T + [5.0, 1.0, 0.0], mesh.faces)


def ball(detail: int = 3, **more: str) -> bytes:
    mesh = icosphere(detail)
    return build_glb(mesh.verts * [1.0, 2.0, 1.0], mesh.faces, **more)


def part_places(word: Word, part: str, shape: int = 0) -> np.ndarray:
    own = word.shapes[shape]
    return own.verts[own.faces[own.labels == word.parts.index(part)]].mean(1)


def test_parts_are_read_as_those_of_the_noun_that_it_is_like(readings: Unkept) -> None:
    word = make_word(GUANACO, {"a.glb": cow(), "b.glb": cow(90.0)}, readings=readings)
    assert (word.noun, word.like) == ("guanaco", "cow")
    assert {"head", "leg", "body"} <= set(word.parts)
    assert [source.source for source in word.sources] == ["a.glb", "b.glb"]
    assert {source.licence for source in word.sources} == {"CC0"}
    for number, shape in enumerate(word.shapes):  # both were turned to their fronts
        assert part_places(word, "head", number)[:, 2].mean() > 0.15
        assert part_places(word, "leg", number)[:, 1].mean() < -0.1
        low, high = shape.verts.min(0), shape.verts.max(0)
        np.testing.assert_allclose(low + high, 0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(high - low), 1, atol=1e-6)


@pytest.mark.usefixtures("_unread")
def test_the_front_is_where_somebody_says() -> None:
    offer = WordOffer("guanaco", front_deg=-90.0, fronts={"b.glb": 180.0})
    one, other = make_word(offer, {"a.glb": arrow(-90.0), "b.glb": arrow(180.0)}).shapes
    np.testing.assert_allclose(one.verts[one.faces], other.verts[other.faces], atol=1e-5)
    with pytest.raises(ParameterError, match=r"no mesh 'c\.glb'"):
        make_word(replace(offer, fronts={"c.glb": 0.0}), {"a.glb": cow()})


@pytest.mark.usefixtures("_unread")
def test_meshes_that_face_differently_are_told_with_where_they_face() -> None:
    files = {"a.glb": arrow(), "b.glb": arrow(0.0, 1.0), "c.glb": arrow(90.0), "d.glb": arrow(180.0)}
    with pytest.raises(ParameterError, match=r"as a.glb does: c.glb, d.glb") as refusal:
        make_word(WordOffer("guanaco"), files)
    assert "--front c.glb=90 --front d.glb=180" in refusal.value.advice_text
    first, *_, last = make_word(WordOffer("guanaco", fronts={"c.glb": 90.0, "d.glb": 180.0}), files).shapes
    np.testing.assert_allclose(first.verts[first.faces], last.verts[last.faces], atol=1e-5)


@pytest.mark.usefixtures("_unread")
def test_what_is_alike_from_all_sides_needs_no_front() -> None:
    assert make_word(WordOffer("egg-cup"), {"a.glb": ball(2), "b.glb": ball(3)}).faces == (320, 1280)


@pytest.mark.usefixtures("_unread")
def test_large_meshes_are_reduced_and_keep_the_parts_that_the_file_names() -> None:
    mesh = icosphere(5)
    upper = mesh.verts[mesh.faces].mean(1)[:, 1] > 0.5
    halves = [
        Primitive(mesh.verts, mesh.faces[rows], material=name, base_color=(1, 1, 1, 1))
        for rows, name in ((upper, "Leaves"), (~upper, "rind"))
    ]
    word = make_word(WordOffer("dragonfruit"), {"fruit.glb": build_glb(halves)})
    (shape,) = word.shapes
    assert MAX_FACES / 2 < len(shape.faces) <= MAX_FACES
    assert word.parts == ("leaf",)
    heights = shape.verts[shape.faces].mean(1)[:, 1] * np.linalg.norm([2, 2, 2])
    assert (heights[shape.labels == 0] > 0.45).all()
    assert (heights[shape.labels < 0] < 0.55).all()


def test_what_the_first_mesh_is_like_decides_for_all(monkeypatch: pytest.MonkeyPatch, readings: Unkept) -> None:
    asked: list[str | None] = []
    nouns = {"cow": 0.95, "dog": 0.05}

    def proposed(_points: object, _body: object, params: object) -> dict[str, float]:
        asked.append(params.source_noun)  # type: ignore[attr-defined]
        return nouns if params.source_noun is None else {params.source_noun: 1.0}  # type: ignore[attr-defined]

    monkeypatch.setattr("meshdeform.runs.reading._proposed", proposed)
    word = make_word(WordOffer("guanaco"), {"a.glb": cow(), "b.glb": cow(0.0, 1.0)}, readings=readings)
    assert word.like == "cow"
    assert asked == [None, "cow"]
    monkeypatch.setattr(making, "_LIKELY", 1.1)
    assert make_word(WordOffer("guanaco"), {"a.glb": cow()}, readings=readings).parts == ()


def test_all_files_that_are_damaged_are_told_at_once() -> None:
    files = {"a.glb": cow()[:2000], "b.obj": POINTS, "c.glb": ball(), "d.obj": FLAT}
    with pytest.raises(
        AssetError, match=r"3 of 4 files cannot be used, and nothing was kept\. a.glb: .* b.obj: "
    ) as told:
        make_word(GUANACO, files)
    assert [each["file"] for each in told.value.extra["files"]] == ["a.glb", "b.obj", "d.obj"]
    for name in ("b.obj", "d.obj"):
        with pytest.raises(AssetEmptyError):
            make_word(GUANACO, {name: files[name]})


def test_a_word_has_so_many_meshes() -> None:
    for files in ({}, {f"{number}.obj": POINTS for number in range(201)}):
        with pytest.raises(ParameterError, match="1 to 200 meshes"):
            make_word(GUANACO, files)


@pytest.mark.usefixtures("_unread")
def test_long_texts_are_refused_before_files_are_read_and_names_of_files_shortened() -> None:
    with pytest.raises(ParameterError, match="licence"):
        make_word(replace(GUANACO, licence="x" * 201), {"a.obj": POINTS})
    name = f"{'deep/' * 60}fruit.glb"
    (source,) = make_word(WordOffer("egg-cup", front_deg=0.0), {name: ball(2)}).sources
    assert len(source.source) == 200
    assert source.source.endswith("deep/fruit.glb")


def test_another_process_makes_it(tmp_path: Path) -> None:
    path, offer = tmp_path / "sent", replace(GUANACO, synonyms=("huanaco",))
    path.write_bytes(cow())
    made = made_word(offer, {"a.glb": path}, tmp_path, Limits()).checked()
    assert (made.noun, made.synonyms, made.like, made.faces) == ("guanaco", ("huanaco",), "cow", (MAX_FACES,))
    assert [(each.source, each.licence) for each in made.sources] == [("a.glb", "CC0")]
    assert "head" in made.parts
    path.write_bytes(POINTS)
    with pytest.raises(AssetEmptyError):
        made_word(offer, {"a.obj": path}, tmp_path, Limits())
