"""Render the views of the real assets that bench/keep/assets.json lists."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch

from meshdeform.assets import Limits, load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.scoring import judging_cameras
from meshdeform.plain.body import loose_body
from meshdeform.vocabulary.nouns import NOUNS
from training.judge.members import ViewSet, pictures

_LIST = Path(__file__).parents[2] / "bench" / "keep" / "assets.json"


def views_of_assets(folder: Path, split: str) -> ViewSet:
    """Render the assets of a split (`bench.keep.assets`) whose files are in a folder, found by their SHA-256."""
    found = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in folder.rglob("*") if path.is_file()}
    listed = [each for each in json.loads(_LIST.read_text(encoding="utf-8")) if each["split"] == split]
    here = [each for each in listed if each["sha256"] in found]
    images = [pictures(mesh_of(found[each["sha256"]]), judging_cameras()) for each in here]
    return ViewSet(torch.stack(images), torch.tensor([list(NOUNS).index(each["noun"]) for each in here]))


def mesh_of(path: Path) -> TriangleMesh:
    """Return an asset as the judge is shown it."""
    body = loose_body(load_asset(path.read_bytes(), path.name, Limits.unlimited()))
    return TriangleMesh(body.points, body.faces)
