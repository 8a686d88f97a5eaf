"""List the collections that nouns are learned from, with their authors and licences, and say who learns from which."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

PRIOR, JUDGE, HELD_OUT = "prior", "judge", "held out"
"""Who may see a member: the prior's training and the judge's, the judge's alone, or nobody before the measurement."""
_HELD_SHARE = 0.1
_JUDGES = {"Tim Steer", "Mesh2Motion", "Kay Lousberg"}
"""Authors whom the prior never sees."""


@dataclass(frozen=True)
class Collection:
    """A public collection of assets."""

    folder: str  # how the names of its folders begin
    author: str
    licence: str  # where CC0 is stated


COLLECTIONS = (
    Collection("trebeljahr+quaternius-showcase", "Quaternius", "quaternius.com: every pack is CC0 1.0"),
    Collection("Malcolmnixon+Quaternius", "Quaternius", "quaternius.com: every pack is CC0 1.0"),
    Collection("fbx/FreeModels by Quaternius", "Quaternius", "License.txt of the packs: CC0 1.0"),
    Collection("fbx/Kenny NL Assets", "Kenney", "License.txt of the kits: CC0 1.0"),
    Collection("Kenney-CCO+Kenney-CCO.glb", "Kenney", "kenney.nl: every asset is CC0 1.0"),
    Collection("KenneyNL+Starter-Kit", "Kenney", "README of the kits: models are CC0 1.0"),
    Collection("pmndrs+market-assets", "Kenney", "market.pmnd.rs: models are CC0 1.0; those by Kenney alone"),
    Collection(
        "samskiezz+jarvis-app/underworld/web/public/models/kenney/", "Kenney", "kenney.nl: every asset is CC0 1.0"
    ),
    Collection(
        "Shaen-ai+metrics_platform_published/public/models/kenney/", "Kenney", "kenney.nl: every asset is CC0 1.0"
    ),
    Collection("M3-org+base-meshes", "Tim Steer", "thebasemesh.com: every mesh is CC0 1.0"),
    Collection("Mesh2Motion+mesh2motion-app", "Mesh2Motion", "LICENSE-CC0.MD: models are CC0 1.0"),
    Collection("KayKit-Game-Assets+", "Kay Lousberg", "LICENSE.txt of the packs: CC0 1.0"),
)
"""FBX files were converted by `assimp export`; packs for patrons alone are left out."""

_MEASURED = tuple(
    f"KayKit-Game-Assets+KayKit-{pack}-Bits" for pack in ("Furniture", "Halloween", "Restaurant", "Space-Base")
)
"""Packs that results are measured on (`bench/nouns`): nothing learns from them."""


def collection_of(path: str) -> Collection | None:
    """Return the collection of a file by its path below the folder of all collections, or None."""
    if path.startswith(_MEASURED):
        return None
    return next((each for each in COLLECTIONS if path.startswith(each.folder)), None)


def pack_of(path: str) -> str:
    """Return the pack of a file: the folder that holds one author's set of things of a kind."""
    parts = path.split("/")
    if parts[0] == MARKET:
        return parts[0]
    inner = [part for part in parts[1:-1] if part.lower() not in INNER]
    return "/".join([parts[0], *inner[:3]])


INNER = frozenset({"public", "glb", "fbx", "models", "fbx format", "files", "addons", "assets", "gltf", "obj"})
MARKET = "pmndrs+market-assets"
"""A collection of several creators' models, each in a folder of its own with an `info.json` that names its creator."""


def creator_of(path: Path) -> str:
    """Return the creator that the `info.json` beside a model names; nothing if there is none."""
    info = path.parent / "info.json"
    return str(json.loads(info.read_text(encoding="utf-8")).get("creator", "")) if info.is_file() else ""


def split_of(members: list[tuple[str, str, str]]) -> dict[str, str]:
    """Say who may learn from each member of a noun.

    The judge alone gets the authors of `_JUDGES`, whom the prior never sees. Where none of them has the noun, it gets
    the author with fewest members, or the smallest pack of a single author, if others remain. A tenth of the others is
    held out; the rest is for both.

    Parameters
    ----------
    members : list of (path, author, pack)

    Returns
    -------
    dict of path to "prior", "judge" or "held out"
    """
    judged = _JUDGES & {author for _, author, _ in members} or _fewest(members, 1) or _fewest(members, 2)
    result = {}
    for member in members:
        digest = int.from_bytes(hashlib.sha256(member[0].encode()).digest()[:4])
        rest = HELD_OUT if digest < _HELD_SHARE * 2**32 else PRIOR
        result[member[0]] = JUDGE if judged & {*member[1:]} else rest
    return result


def _fewest(members: list[tuple[str, str, str]], column: int) -> set[str]:
    """Return the author (column 1) or pack (2) that has fewest members; nothing if there is no other."""
    counts = Counter(member[column] for member in members)
    return {min(sorted(counts), key=lambda name: counts[name])} if len(counts) > 1 else set()
