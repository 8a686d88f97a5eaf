"""Keep samples of the members of a noun: drawing them takes up to a second and a half, reading them from a file 10 ms.

The number of a draw decides all of a member: its form, whether it has random attributes of parts (every other one),
and its pose (two of three of those that can stand otherwise). A file has the name of its noun and of the version of
the code that drew it; it is written aside and renamed, and one that is damaged is drawn anew.
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

from meshdeform.nouns.forms import FORMS, GENERAL, drawn
from meshdeform.nouns.labels import LabelledMember
from meshdeform.nouns.poses import POSES, posed
from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.vocabulary import NOUNS, PARTS
from meshdeform.reading.samples import spread
from meshdeform.reading.version import MEMBERS_VERSION
from meshdeform.support.files import write_files

__all__ = ["MEMBERS", "SAMPLES", "Bank", "bank_of", "candidate_member", "is_general", "prepare"]

MEMBERS, SAMPLES = 110, 700
_IN_MEMORY = 24
_log = logging.getLogger(__name__)

Singles = NDArray[np.float32]


@dataclass(frozen=True)
class Bank:
    """Samples of all M members of a noun, of N places each.

    `places` and `normals` (M, N, 3) float32, of the precision of float16 so that a file changes nothing; boxes `low`
    and `high` (M, 3) float32.
    """

    places: Singles
    normals: Singles
    low: Singles
    high: Singles


_SHAPES = {"places": (MEMBERS, SAMPLES, 3), "normals": (MEMBERS, SAMPLES, 3), "low": (MEMBERS, 3), "high": (MEMBERS, 3)}


def form_of(noun: str, number: int) -> str:
    """Return the family or the form of the member of a number."""
    return FORMS[noun][number % len(FORMS[noun])]


def is_general(noun: str, number: int) -> bool:
    """Return whether a member is of a form that other nouns have as well."""
    return form_of(noun, number) in GENERAL


def candidate_member(noun: str, number: int) -> LabelledMember:
    """Draw the member of a number, with attributes and a pose of its own."""
    form, seed = form_of(noun, number), number // len(FORMS[noun]) + 1
    rng = np.random.default_rng([seed, 71])
    attributes = []
    if seed % 2:
        attributes = [
            Attribute(part, PARTS[part][int(rng.integers(2))]) for part in NOUNS.get(form, ()) if rng.random() < 0.5
        ]
    member = drawn(form, attributes, rng)
    poses = POSES.get(form, ())
    if seed % 3 == 0:
        for pose in ("walking", "turned"):
            member = posed(member, pose, rng) if pose in poses else member
    others = [pose for pose in poses if pose not in ("walking", "turned")]
    if seed % 3 == 1 and others:
        member = posed(member, others[int(rng.integers(len(others)))], rng)
    return member


@lru_cache(maxsize=_IN_MEMORY)
def bank_of(noun: str, folder: Path | None = None) -> Bank:
    """Return the samples of a noun's members: of a file in the folder, or drawn and then written there."""
    path = None if folder is None else folder / f"{noun}-{MEMBERS_VERSION}.npz"
    kept = None if path is None else _kept(path)
    if kept is not None:
        return kept
    bank = _drawn(noun)
    if path is not None:
        _keep(bank, path)
    return bank


def prepare(noun: str, folder: Path | None = None) -> None:
    """Draw the members of a noun, so that a later reading does not wait for it."""
    bank_of(noun, folder)


def _drawn(noun: str) -> Bank:
    members = [candidate_member(noun, number) for number in range(MEMBERS)]
    samples = [spread(member.verts, member.faces, SAMPLES, 2) for member in members]
    mixed = np.random.default_rng(5).permutation(SAMPLES)  # so that the first few are spread as all are
    places = np.stack([one.places[mixed] for one in samples])
    normals = np.stack([one.normals[mixed] for one in samples])
    low, high = (np.stack([bound(member.verts, axis=0) for member in members]) for bound in (np.min, np.max))
    return Bank(*(array.astype(np.float16).astype(np.float32) for array in (places, normals, low, high)))


def _kept(path: Path) -> Bank | None:
    """Return the bank of a file; None if there is none, or it is damaged."""
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: file[name] for name in _SHAPES}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, NotImplementedError):
        _log.warning("%s is damaged: it is drawn anew", path.name)
        return None
    if any(array.shape != _SHAPES[name] or array.dtype != np.float16 for name, array in arrays.items()):
        _log.warning("%s is damaged: it is drawn anew", path.name)
        return None
    return Bank(**{name: array.astype(np.float32) for name, array in arrays.items()})


def _keep(bank: Bank, path: Path) -> None:
    """Write a bank, and remove those of other versions; without room or leave to write, the noun is drawn again."""
    packed = io.BytesIO()
    np.savez(packed, **{field.name: getattr(bank, field.name).astype(np.float16) for field in fields(Bank)})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_files({path: packed.getvalue()})
        for old in path.parent.glob(f"{path.name.partition('-')[0]}-*.npz"):
            if old.name != path.name:
                old.unlink(missing_ok=True)
    except OSError as error:
        _log.warning("the samples of a noun are not kept: %s", error)
