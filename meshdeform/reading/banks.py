"""Keep samples of the members of a noun: drawing them takes up to a second and a half, reading them from a file 10 ms.

The number of a draw decides all of a member. What assets are read by shall be of all kinds: the number decides the
form, whether there are random attributes of parts (every other one), and the pose (two of three of those that can
stand otherwise). What has given attributes, which may be none, has exactly these; it is of a form that no other noun
has, and is drawn in all poses in turn. Beyond `MEMBERS` come members of the kinds of a noun by which its parts are not
read (`nouns.forms`): they tell nouns alone.

Members of a word of somebody's own (`meshdeform.words`) are its shapes.

A file has the name of its noun, or of the word's hash, of its attributes and of the version of the code that drew it;
it is written aside and renamed, and one that is damaged is drawn anew. Of those with attributes and those of words, the
newest `_MOST_FILES` are kept.
"""

from __future__ import annotations

import io
import logging
import zipfile
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshdeform.nouns.forms import FORMS, GENERAL, drawn, other_kinds, own_forms
from meshdeform.nouns.labels import Floats, LabelledMember
from meshdeform.nouns.limbs import limb_codes
from meshdeform.nouns.poses import POSES, posed
from meshdeform.reading.samples import spread
from meshdeform.reading.version import MEMBERS_VERSION
from meshdeform.support.files import write_files
from meshdeform.support.giving_way import give_way
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.words.in_use import own_word
from meshdeform.words.members import word_member

__all__ = [
    "MEMBERS",
    "SAMPLES",
    "Bank",
    "bank_of",
    "candidate_member",
    "form_of",
    "is_general",
    "members_with_parts",
    "pose_of",
]

MEMBERS, SAMPLES = 110, 700
_OF_A_KIND = 8
"""Members of each kind by which parts are not read."""
_WISHED, _WISHED_WITH_ATTRIBUTES = 128, 64
"""Members that have given attributes: of none, and of any, which few ask for again."""
_IN_MEMORY = 24
_MOST_FILES = 64
_LIKENESS = ("walking", "turned")
"""Poses that go with others."""
_log = logging.getLogger(__name__)

Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Attributes = tuple[Attribute, ...] | None
"""Those that members are to have; None where they have random ones."""
_SMALL = ("labels", "limbs")
_SHAPES = {
    "positions": (SAMPLES, 3), "normals": (SAMPLES, 3), "low": (3,), "high": (3,), "labels": (SAMPLES,),
    "limbs": (SAMPLES,),
}  # fmt: skip


@dataclass(frozen=True)
class Bank:
    """Samples of all M members of a noun, of N points each.

    `positions` and `normals` (M, N, 3) float32, of the precision of float16 so that a file changes nothing; boxes `low`
    and `high` (M, 3) float32. `labels` and `limbs` (M, N) uint8: the part and the limb (`nouns.limbs`) of each point.
    """

    positions: Singles
    normals: Singles
    low: Singles
    high: Singles
    labels: Bytes
    limbs: Bytes

    def __len__(self) -> int:
        return len(self.positions)


def members_of(noun: str, attributes: Attributes) -> int:
    """Return how many members a bank has."""
    word = own_word(noun)
    if word is not None:
        return len(word.sources)
    if attributes is None:
        return MEMBERS + _OF_A_KIND * len(other_kinds(noun))
    return _WISHED_WITH_ATTRIBUTES if attributes else _WISHED


def members_with_parts(noun: str) -> int:
    """Return how many members of a noun, the first ones, its parts are read by."""
    return MEMBERS if own_word(noun) is None else members_of(noun, None)


def form_of(noun: str, number: int, attributes: Attributes = None) -> str:
    """Return the family or the form of the member of a number."""
    if own_word(noun) is not None:
        return noun
    if attributes is None and number >= MEMBERS:
        return other_kinds(noun)[(number - MEMBERS) // _OF_A_KIND]
    forms = FORMS[noun] if attributes is None else own_forms(noun, attributes)
    return forms[number % len(forms)]


def pose_of(noun: str, number: int, attributes: tuple[Attribute, ...]) -> str:
    """Return the pose of the member of a number that has given attributes; empty if it is that of its family."""
    if own_word(noun) is not None:
        return ""
    forms = own_forms(noun, attributes)
    others = [pose for pose in POSES.get(forms[number % len(forms)], ()) if pose not in _LIKENESS]
    return ["", *others][number // len(forms) % (1 + len(others))]


def is_general(noun: str, number: int) -> bool:
    """Return whether a member is of a form that other nouns have as well."""
    return form_of(noun, number) in GENERAL


def candidate_member(noun: str, number: int, attributes: Attributes = None) -> LabelledMember:
    """Draw the member of a number, with a pose of its own; without given attributes, with some of its own."""
    word = own_word(noun)
    if word is not None:
        return word_member(word, number, attributes or ())
    form, seed = form_of(noun, number, attributes), number // len(FORMS[noun]) + 1
    if attributes is not None:
        return _member_of_form(form, pose_of(noun, number, attributes), number, attributes)
    if number >= MEMBERS:
        return drawn(form, (), np.random.default_rng([number, 74]))
    rng = np.random.default_rng([seed, 71])
    random = []
    if seed % 2:
        random = [
            Attribute(part, PARTS[part][int(rng.integers(2))]) for part in NOUNS.get(form, ()) if rng.random() < 0.5
        ]
    member = drawn(form, random, rng)
    poses = POSES.get(form, ())
    if seed % 3 == 0:
        for pose in _LIKENESS:
            member = posed(member, pose, rng) if pose in poses else member
    others = [pose for pose in poses if pose not in _LIKENESS]
    if seed % 3 == 1 and others:
        member = posed(member, others[int(rng.integers(len(others)))], rng)
    return member


def _member_of_form(form: str, pose: str, number: int, attributes: tuple[Attribute, ...]) -> LabelledMember:
    member = drawn(form, attributes, np.random.default_rng([number, 72]))
    return posed(member, pose, np.random.default_rng([number, 73])) if pose else member


def bank_of(noun: str, folder: Path | None = None, attributes: Attributes = None) -> Bank:
    """Return the samples of a noun's members: of a file in the folder, or drawn and then written there."""
    word = own_word(noun)
    return _bank_of(noun, noun if word is None else f"own+{word.sha256[:16]}", folder, attributes)


@lru_cache(maxsize=_IN_MEMORY)
def _bank_of(noun: str, called: str, folder: Path | None, attributes: Attributes) -> Bank:
    """Return the bank of a noun; `called` tells it from others of the same noun."""
    path = None if folder is None else folder / f"{_file_stem(called, attributes)}-{MEMBERS_VERSION}.npz"
    found = None if path is None else _read_bank(path, members_of(noun, attributes))
    if found is not None:
        return found
    bank = _draw_bank(noun, attributes)
    if path is not None:
        _write_bank(bank, path)
    return bank


def _file_stem(called: str, attributes: Attributes) -> str:
    """Return the name of the bank of a noun with attributes: `dog`, `dog+`, `dog+long_tail`; without hyphens."""
    if attributes is None:
        return called
    return f"{called}+" + "+".join(sorted(f"{each.degree}_{each.part}" for each in attributes))


def _draw_bank(noun: str, attributes: Attributes) -> Bank:
    members = []
    for number in range(members_of(noun, attributes)):
        give_way()
        members.append(candidate_member(noun, number, attributes))
    samples = [spread(member.verts, member.faces, SAMPLES, 2) for member in members]
    mixed = np.random.default_rng(5).permutation(SAMPLES)  # so that the first few are spread as all are
    positions = np.stack([one.positions[mixed] for one in samples])
    normals = np.stack([one.normals[mixed] for one in samples])
    low, high = (np.stack([bound(member.verts, axis=0) for member in members]) for bound in (np.min, np.max))
    labels, limbs = (
        np.stack([of_faces(member)[one.faces[mixed]] for member, one in zip(members, samples, strict=True)])
        for of_faces in (lambda member: member.labels, limb_codes)
    )
    return Bank(
        _single(positions),
        _single(normals),
        _single(low),
        _single(high),
        labels=labels.astype(np.uint8),
        limbs=limbs.astype(np.uint8),
    )


def _single(array: Floats) -> Singles:
    """Return numbers in the precision of float16."""
    return array.astype(np.float16).astype(np.float32)


def _read_bank(path: Path, members: int) -> Bank | None:
    """Return the bank of a file; None if there is none, or it is damaged."""
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: file[name] for name in _SHAPES}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError):
        _log.warning("%s is damaged: it is drawn anew", path.name)
        return None
    dtypes = {name: np.uint8 if name in _SMALL else np.float16 for name in arrays}
    if any(array.shape != (members, *_SHAPES[name]) or array.dtype != dtypes[name] for name, array in arrays.items()):
        _log.warning("%s is damaged: it is drawn anew", path.name)
        return None
    return Bank(**{name: array if name in _SMALL else array.astype(np.float32) for name, array in arrays.items()})


def _write_bank(bank: Bank, path: Path) -> None:
    """Write a bank, and remove what is of other versions or too much; without room or leave, it is drawn again."""
    packed = io.BytesIO()
    arrays = {field.name: getattr(bank, field.name) for field in fields(Bank)}
    np.savez(packed, **{name: array if name in _SMALL else array.astype(np.float16) for name, array in arrays.items()})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_files({path: packed.getvalue()})
        for old in path.parent.glob(f"{path.name.partition('-')[0]}-*.npz"):
            if old.name != path.name:
                old.unlink(missing_ok=True)
        of_attributes = sorted(path.parent.glob("*+?*-*.npz"), key=lambda file: file.stat().st_mtime)
        for old in of_attributes[:-_MOST_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:
        _log.warning("the samples of a noun are not kept: %s", error)
