"""Judge the likeness of a result, and what broke of its structure; find what the source is.

Ranks of nouns are among all that the judge knows. What follows from both is decided in `meshdeform.runs.worth`. What
the source is, `recognise` finds in the same way, among the nouns of the builtin prior.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.deformation.orientation import Front, Mixture
from meshdeform.errors import ModelError, PromptError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure_structure
from meshdeform.geometry.torch_threads import one_torch_thread
from meshdeform.judge import Judge
from meshdeform.priors.base import Prior
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUN_GROUPS, TURNED
from meshdeform.reading import Reading
from meshdeform.requests.choices import OrientationMode, is_builtin
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.goals import score_distillation
from meshdeform.runs.prompts import Prompts

_log = logging.getLogger(__name__)
_SURE, _SURE_READ, _CALLED = 0.97, 0.9, 0.5
"""Probability from which a source counts as recognised by the judge alone and by its reading, and from which it does if
the prompt calls it the same: as of 19 of 20 real assets it is right (`bench.recognition`)."""

_LIKELY, _CERTAIN, _MOST = 0.5, 0.8, 3
"""Probabilities from which a source's noun says how it is treated, and from which it alone says where the front is;
number of nouns that say it otherwise."""

CROOKED = frozenset({"twisted", "leaning", "bent"})
"""Words of prompts that cost symmetry and flatness."""

_LIMBS = ("head", "arm(?!at)|hand(?!le)", "leg|thigh|foot")
_OF_ANIMALS = "tail|wing|front|paw|hoof"
"""In the names of joints: of a person, and of nobody."""

_BUILT = ("vehicles", "furniture", "buildings", "vessels and tools")
_Compare = Callable[[TriangleMesh, str], dict[str, Any] | None]
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]

LIMITS = {
    "asymmetry": 0.01,  # of the diagonal: a leg or a wheel is seen to be longer than its mirror image
    "flatness": 0.01,  # of a piece's diagonal: a table top or a wall is seen to bulge
    "contacts": 0.005,  # of the diagonal: a gap between parts is seen
    "cut_share": 0.01,  # of the faces: fewer usually hide where parts meet
    "flipped_faces": 0.0,  # each is a hole or a dark spot
    "opened_junctions": 0.0,  # each is the end of a crack, through which one looks into the asset
}
"""Largest figures of a result whose structure counts as kept."""

_SENTENCES = {
    "asymmetry": "Mirror symmetry was lost: {:.1%} of the diagonal.",
    "flatness": "Flat pieces were bent: {:.1%} of their diagonals.",
    "contacts": "Parts that touched came apart: {:.1%} of the diagonal.",
    "cut_share": "Faces newly cut others: {:.1%} of all.",
    "flipped_faces": "Faces were flipped: {:,}.",
    "opened_junctions": "Cracks opened: {:,} of the vertices on edges of other faces came off.",
}


@dataclass(frozen=True)
class Recognition:
    """Noun that a source was taken for."""

    noun: str  # the most probable noun; empty if there is no judge
    probability: float  # 1 for a noun that the request gives
    nouns: Mapping[str, float] = field(default_factory=dict)
    """The probabilities of all nouns; empty if no judge was asked."""
    called: str = ""  # what the prompt says that it is
    read: bool = False  # whether the reading decided, not the judge alone

    @property
    def sure(self) -> bool:
        """Whether the source counts as recognised."""
        by_itself = _SURE_READ if self.read else _SURE
        return self.probability >= (_CALLED if self.called == self.noun else by_itself)

    def with_reading(self, reading: Reading | None) -> Recognition:
        """Return what a reading took the source for, which is right more often than the judge alone.

        It has the judge's probabilities of all nouns.
        """
        if reading is None:
            return self
        return replace(self, noun=reading.noun, probability=reading.probability, read=True)

    @property
    def likely_noun(self) -> str:
        """The noun if it is likely, else an empty text."""
        return self.noun if self.probability >= _LIKELY else ""

    @property
    def certain(self) -> bool:
        """Whether nothing else is likely."""
        return self.probability >= _CERTAIN

    @property
    def built(self) -> bool:
        """Whether it is likely to be something that people build, which stands upright."""
        return any(self.likely_noun in NOUN_GROUPS[group] for group in _BUILT)

    def likely(self) -> dict[str, float]:
        """Return the nouns that it most likely is, with their weights; none if too little is known."""
        if self.certain:
            return {self.noun: 1.0}
        first = dict(sorted(self.nouns.items(), key=lambda item: -item[1])[:_MOST])
        total = sum(first.values())
        return {noun: probability / total for noun, probability in first.items()} if total >= _LIKELY else {}

    def to_dict(self) -> dict[str, Any]:
        """Return the member `source_noun` of the report."""
        return {"noun": self.noun, "probability": round(self.probability, 4), "recognised": self.sure}


def recognise(mesh: TriangleMesh, noun_given: str | None = None, joints: Iterable[str] = ()) -> Recognition:
    """Return the noun that a mesh, +Y up, is taken for, or the one that is given for it.

    With the joints of a person it is one, unless it clearly is another figure: to the judge, whoever holds out both
    arms looks like a helicopter.
    """
    if noun_given is not None:
        return Recognition(noun_given, 1.0)
    try:
        nouns = Judge().noun_probabilities(mesh)
    except ModelError as error:
        _log.warning("the source is not recognised: %s", error)
        return Recognition("", 0.0)
    noun = max(nouns, key=nouns.__getitem__)
    recognition = Recognition(noun, nouns[noun], nouns)
    figure = recognition.likely_noun in NOUN_GROUPS["figures"]
    return Recognition("person", 1.0, nouns) if _is_person(joints) and not figure else recognition


def _is_person(joints: Iterable[str]) -> bool:
    names = " ".join(joints).lower()
    return all(re.search(part, names) for part in _LIMBS) and not re.search(_OF_ANIMALS, names)


def known_source(
    mesh: TriangleMesh,
    prior: Prior | None,
    params: ResolvedParams,
    known: Recognition | None = None,
    joints: Iterable[str] = (),
) -> Recognition | None:
    """Return the noun of a run's source, `known` if it was asked; None where nothing depends on it."""
    if prior is None or not is_builtin(params.model) or params.orientation is not OrientationMode.AUTO:
        return None
    return known or recognise(mesh, params.source_noun, joints)


def front_of(source: Recognition | None, prior: Prior | None, params: ResolvedParams, prompt: str) -> Front | None:
    """Return who finds the front of a source: the prior, asked for what the source is."""
    if source is None or prior is None:
        return None
    likely = [(score_distillation(prior, f"a {noun}", params), weight) for noun, weight in source.likely().items()]
    grader = Mixture(likely) if likely else None
    try:
        reading = parse(prompt)
    except (PromptError, VocabularyError):  # there is none, or it has taught words
        return Front(grader, source.built)
    grown = not any(reading.noun in NOUN_GROUPS[group] for group in _BUILT)
    crooked = any(attribute.degree in CROOKED for attribute in reading.attributes)
    return Front(grader, source.built, grown, crooked, reading.noun in TURNED)


def kept_structure(source: TriangleMesh, result: TriangleMesh, quality: Mapping[str, Any]) -> dict[str, Any]:
    """Measure how much a result kept of its source.

    `source` and `result`: with the same faces, +Y up; `quality`: the fields of
    `meshdeform.geometry.quality.MeshQuality` for these two. Returns dict: the fields of
    `meshdeform.geometry.quality.Structure`, `cut_share` (of the faces; 0 if not counted), `flipped_faces` and
    `opened_junctions`.
    """
    cuts = quality["self_intersections_added"] or 0
    faults = {name: quality[name] for name in ("flipped_faces", "opened_junctions")}
    return {**measure_structure(source, result).to_dict(), "cut_share": cuts / len(source.faces), **faults}


def worse_than_source(before: int, after: int, structure: Mapping[str, Any]) -> bool:
    """Return whether a noun gained no rank at all, from `before` to `after`, while the structure suffered."""
    return after >= before and bool(_beyond(structure))


def broken(
    structure: Mapping[str, Any], excused: Collection[str] = (), tolerated: Mapping[str, float] | None = None
) -> list[str]:
    """Return what of a structure is beyond its limits, in sentences.

    `excused`: figures that do not count; `tolerated`: by which factor a figure may exceed its limit.
    """
    return [_SENTENCES[name].format(structure[name]) for name in _beyond(structure, excused, tolerated)]


def _beyond(
    structure: Mapping[str, Any], excused: Collection[str] = (), tolerated: Mapping[str, float] | None = None
) -> list[str]:
    """Return the figures that are beyond their limits."""
    factors = tolerated or {}
    return [
        name
        for name, limit in LIMITS.items()
        if name not in excused and (structure.get(name) or 0.0) > limit * factors.get(name, 1.0)
    ]


def prompt_reports(
    prompts: Prompts, rest: TriangleMesh, mesh: TriangleMesh, compare: _Compare | None
) -> list[dict[str, Any]]:
    """Return the report's `prompts`: each with its weight, its region, and what became of it.

    `rest` and `mesh`: the welded source and result in their world. `compare`: compares a mesh with a prompt; a prompt
    with a region is compared with the region alone, of the source as well (`before`), since what a piece of an asset
    looks like to the judge says little by itself.
    """
    reports = []
    diagonal = float(np.linalg.norm(np.ptp(rest.verts.numpy(), axis=0)))
    moved = (mesh.verts - rest.verts).square().sum(1).numpy() / diagonal**2
    corners = mesh.faces.numpy()
    for each, faces in zip(prompts.given, prompts.faces, strict=True):
        report = each.model_dump(mode="json", exclude_none=True)
        report["faces"] = len(mesh.faces) if faces is None else int(faces.sum())
        if faces is not None:
            within = np.zeros(len(moved), bool)
            within[corners[faces].ravel()] = True
            report["moved"] = {"inside": _rms(moved[within]), "outside": _rms(moved[~within])}
        if compare is not None:
            report["likeness"] = likeness = compare(mesh if faces is None else _part(mesh, faces), each.prompt)
            if faces is not None and likeness is not None:
                likeness["before"] = before(compare(_part(rest, faces), each.prompt))
        reports.append(report)
    return reports


def _rms(squares: _Floats) -> float:
    return float(np.sqrt(squares.mean())) if len(squares) else 0.0


def _part(mesh: TriangleMesh, faces: _Flags) -> TriangleMesh:
    """Return some faces of a mesh as a mesh of their own."""
    chosen = mesh.faces[torch.from_numpy(faces)]
    used, corners = torch.unique(chosen, return_inverse=True)
    verts: Tensor = mesh.verts[used]
    return TriangleMesh(verts, corners.view(-1, 3))


@one_torch_thread()
def likeness(mesh: TriangleMesh, prompt: str) -> dict[str, Any] | None:
    """Compare a mesh with the noun of a prompt of the builtin prior.

    `mesh`: +Y up, of any position and size. Returns as in `summarize`, with the judge's identity; None if its weights
    are missing or damaged, which is logged.
    """
    try:
        judge = Judge()
    except ModelError as error:
        _log.warning("the result's likeness is not estimated: %s", error)
        return None
    return {**summarize(judge.noun_probabilities(mesh), parse(prompt).noun), "judge": judge.identity}


def likeness_and_before(
    source: TriangleMesh, result: TriangleMesh, prompt: str, nouns: Mapping[str, float]
) -> dict[str, Any] | None:
    """Compare a result and its source with the noun of a prompt.

    `nouns`: the probabilities of all nouns for the source; if it is empty, the judge is asked. Returns the likeness of
    the result, with that of the source as `before`; None as in `likeness`.
    """
    compared = likeness(result, prompt)
    if compared is not None:
        compared["before"] = before(summarize(nouns, compared["noun"]) if nouns else likeness(source, prompt))
    return compared


def summarize(probabilities: Mapping[str, float], noun: str) -> dict[str, Any]:
    """Summarize the probabilities of all nouns for a result that should be `noun`.

    Returns dict: `noun`, its `probability` and `rank` from 1, the number of `nouns`, the most probable other one as
    `next`, and `matches`: whether the rank is 1.
    """
    share = probabilities[noun]
    other = max((name for name in probabilities if name != noun), key=probabilities.__getitem__)
    rank = 1 + sum(probability > share for probability in probabilities.values())
    return {
        "noun": noun,
        "probability": round(share, 4),
        "rank": rank,
        "nouns": len(probabilities),
        "next": {"noun": other, "probability": round(probabilities[other], 4)},
        "matches": rank == 1,
    }


def before(source: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the member `before` of a likeness: what the likeness of the source says of the same noun."""
    return None if source is None else {name: source[name] for name in ("probability", "rank")}
