"""Render the views of the real assets that results are measured on (bench/), of which none trains the judge."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.scoring import judging_cameras
from meshdeform.plain.body import loose_body
from meshdeform.vocabulary.nouns import NOUNS
from training.judge.members import ViewSet, pictures

_BENCH = Path(__file__).parents[2] / "bench"
TUNED, LAST, OTHERS = "bench/keep, tuned", "bench/keep, last", "others"
"""Sets of assets; those of bench/nouns/members.json are called by their split."""


@dataclass(frozen=True)
class Listed:
    """An asset of a list."""

    noun: str
    sha256: str
    up: str = "+Y"

    @classmethod
    def of(cls, entry: dict[str, Any]) -> Listed:
        """Return an entry of a list."""
        return cls(entry["noun"], entry["sha256"], entry.get("up", "+Y"))


def listed() -> dict[str, list[Listed]]:
    """Return the assets of each set.

    The sharpness is fitted on `TUNED`. `OTHERS`: of `bench/keep`, `bench/parts` and `bench/recognition.json` all that
    are in neither of the other sets, each once.
    """
    keep, parts, recognition, members = (
        json.loads((_BENCH / name).read_text(encoding="utf-8"))
        for name in ("keep/assets.json", "parts/assets.json", "recognition.json", "nouns/members.json")
    )
    sets = {f"bench/keep, {split}": [Listed.of(each) for each in keep if each["split"] == split] for split in _SPLITS}
    named = [Listed(noun, digest) for each in recognition for _, noun, digest in each["files"]]
    every = {each.sha256: each for each in (*named, *map(Listed.of, (*parts, *keep)))}
    taken = {each.sha256 for assets in sets.values() for each in assets}
    sets[OTHERS] = [each for digest, each in every.items() if digest not in taken]
    for each in members:
        sets.setdefault(f"bench/nouns, {each['split']}", []).append(Listed.of(each))
    return sets


_SPLITS = ("tuned", "last")


def views_of_assets(folder: Path, assets: Sequence[Listed]) -> ViewSet:
    """Render the assets whose files are in a folder, beside what they refer to; they are found by their SHA-256."""
    found = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in folder.rglob("*") if path.is_file()}
    here = [each for each in assets if each.sha256 in found and each.noun in NOUNS]
    images = [pictures(mesh_of(found[each.sha256], each.up), judging_cameras()) for each in here]
    return ViewSet(torch.stack(images), torch.tensor([list(NOUNS).index(each.noun) for each in here]))


def mesh_of(path: Path, up: str = "+Y") -> TriangleMesh:
    """Return an asset as the judge is shown it; `up`: its upward axis, +Y or +Z."""
    limits = Limits.unlimited()
    body = loose_body(load_asset(read_with_files(path, limits), path.name, limits))
    points = body.points if up == "+Y" else body.points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    return TriangleMesh(points, body.faces)
