"""What a result looks like, what broke of it, and what its source is taken for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshdeform.assets import build_glb
from meshdeform.deformation.orientation import Orientation, OrientationSource
from meshdeform.deformation.structure import Nature
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.structure_changes import measure_structure
from meshdeform.priors import load_prior
from meshdeform.reading import Reading
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.runs.front import asks_source, front_of
from meshdeform.runs.kept_structure import kept_structure
from meshdeform.runs.likeness import before, likeness
from meshdeform.runs.recognition import Recognition, nature_of
from tests.cases import each_case
from tests.unit.runs.jobs import finished, started
from training.judge.members import HELD_OUT, draw_shape, seeded

WHOLE = {
    "asymmetry": 0.0,
    "flatness": None,
    "contacts": 0.0,
    "cut_share": 0.0,
    "flipped_faces": 0,
    "opened_junctions": 0,
}


def test_what_was_kept_is_measured_on_the_shapes() -> None:
    ball = icosphere(3)
    verts = ball.verts.copy()
    verts[0] *= -1.5
    result = TriangleMesh(verts, ball.faces)
    quality = measure(ball.verts, ball.faces, verts).to_dict()
    assert kept_structure(ball, ball, {**quality, "self_intersections_added": None})["cut_share"] == 0
    structure = kept_structure(ball, result, quality)
    assert structure["cut_share"] == pytest.approx(quality["self_intersections_added"] / len(ball.faces))
    assert structure["cut_share"] > 0
    assert structure["flipped_faces"] == quality["flipped_faces"]
    assert structure.items() >= measure_structure(ball, result).to_dict().items()


# The report says whether a result looks like its prompt.


def test_a_giraffe_that_nothing_was_trained_with_matches_its_prompt_and_no_other() -> None:
    part = draw_shape("other giraffe", seeded(HELD_OUT, "other giraffe", 2000))
    mesh = TriangleMesh(part.verts, part.faces)
    same, other = likeness(mesh, "a giraffe"), likeness(mesh, "a tall vase")
    assert same is not None
    assert other is not None
    assert (same["noun"], same["rank"], same["nouns"], same["matches"]) == ("giraffe", 1, 474, True)
    assert same["probability"] > same["next"]["probability"]
    assert other["noun"] == "vase"
    assert other["rank"] > 1
    assert other["next"] == {"noun": "giraffe", "probability": same["probability"]}
    assert other["matches"] is False
    assert set(same["judge"]) == {"id", "revision", "sha256"}


@each_case("guidance, carrier", [("sds", "auto"), ("sds", "surface"), ("target", "auto")])
def test_a_prompt_has_it_and_every_report_a_verdict(guidance: str, carrier: str) -> None:
    ball = icosphere(1)
    asset = build_glb(ball.verts, ball.faces)
    prior = load_prior("builtin", device="cpu")
    params = {"guidance": guidance, "carrier": carrier}
    _, report = finished(started(asset, "a mushroom", steps=1, target=asset, prior=prior, **params))
    assert ("likeness" in report) == (guidance == "sds")
    assert set(report["verdict"]) == {"value", "reasons", "advice", "structure"}
    assert set(report["verdict"]["structure"]) >= {"asymmetry", "cut_share"}
    assert 0 <= report["quality"]["kept_share"] <= 1
    if guidance == "sds":
        assert report["likeness"]["noun"] == "mushroom"
        source = TriangleMesh(ball.verts.astype(np.float32).astype(np.float64), ball.faces)
        assert report["likeness"]["before"] == before(likeness(source, "a mushroom"))
        assert report["verdict"]["value"] == "doubtful"  # one step


# What a source is taken for, and what follows from it.


def of(**guidance: object) -> ResolvedParams:
    return resolve(DeformParams.model_validate({"guidance": {"kind": "sds", "model": "builtin", **guidance}}))


def read_as(noun: str, probability: float) -> Reading:
    labels, back = np.zeros(1, np.int64), np.diag([-1.0, 1.0, -1.0])
    return Reading(noun, {noun: probability}, back, 0.5, labels, {}, 0, 0.01)


@each_case(
    ("given", "reading", "noun", "sure", "built"),
    [
        (None, read_as("chair", 0.6), "chair", False, True),
        (None, read_as("chair", 0.4), "chair", False, False),
        (None, read_as("dog", 0.95), "dog", True, False),
        (None, None, "", False, False),
        ("puppies", read_as("dog", 1.0), "dog", True, False),
        ("a thing", read_as("chair", 0.6), "a thing", True, False),
    ],
)
def test_a_source_is_what_the_request_says_or_what_it_was_read_as(
    given: str | None, reading: Reading | None, noun: str, sure: bool, built: bool
) -> None:
    source = Recognition.of(of(source_noun=given), reading)
    assert (source.noun, source.sure, source.built) == (noun, sure, built)
    assert source.to_dict()["recognised"] is sure


@each_case(
    "reading, prompt, expected",
    [
        (read_as("dog", 0.7), "a giraffe", Nature(grown=True)),
        (read_as("dog", 0.8), "", Nature()),
        (read_as("bottle", 0.9), "a tall vase", Nature(built=True, turned=True)),
        (read_as("bottle", 0.9), "a leaning vase", Nature(built=True, crooked=True, turned=True)),
        (None, "a giraffe", Nature(grown=True)),
    ],
)
def test_source_and_prompt_say_what_is_to_be_kept(reading: Reading | None, prompt: str, expected: Nature) -> None:
    assert nature_of(of(), reading, prompt) == expected
    assert nature_of(of(orientation="keep"), reading, prompt) == Nature()


def test_the_front_is_that_of_the_reading_where_the_model_sees_the_azimuth() -> None:
    read, known = read_as("dog", 0.9), of()
    assert front_of(read, known) == Orientation(180.0, OrientationSource.FOUND)
    assert front_of(replace(read, front_margin=0.01), known) == Orientation(180.0, OrientationSource.UNDECIDED)
    assert front_of(None, known) == Orientation(0.0, OrientationSource.UNRECOGNISED)
    unconditioned = of(model="some/checkpoint", orientation="auto")
    assert front_of(read, unconditioned) == Orientation(0.0, OrientationSource.UNCONDITIONED)
    asked = [asks_source(each) for each in (known, of(orientation="keep"), unconditioned)]
    assert asked == [True, False, False]
