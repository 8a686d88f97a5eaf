"""List the collections that nouns are learned from, with their authors and licences, and say who learns from which."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

PRIOR, JUDGE, HELD_OUT = "prior", "judge", "held out"
"""Who may see a member: the prior's training, the judge's, or nobody before the measurement."""
_HELD_SHARE = 0.1


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
    Collection("KayKit-Game-Assets+", "Kay Lousberg", "LICENSE.txt of the packs: CC0 1.0"),
)
"""FBX files were converted by `assimp export`; packs for patrons alone are left out."""


def collection_of(path: str) -> Collection | None:
    """Return the collection of a file by its path below the folder of all collections, or None."""
    return next((each for each in COLLECTIONS if path.startswith(each.folder)), None)


def pack_of(path: str) -> str:
    """Return the pack of a file: the folder that holds one author's set of things of a kind."""
    parts = path.split("/")
    if parts[0] in _FLAT:  # a folder for each model
        return parts[0]
    inner = [part for part in parts[1:-1] if part.lower() not in _INNER]
    return "/".join([parts[0], *inner[:3]])


_INNER = frozenset({"public", "glb", "fbx", "models", "fbx format", "files", "addons", "assets", "gltf", "obj"})
_FLAT = frozenset({"pmndrs+market-assets"})


def split_of(noun_members: list[tuple[str, str, str]]) -> dict[str, str]:
    """Say who may learn from each member of a noun.

    The judge gets one author's, where others remain for the prior: Kay Lousberg's before others, else the author with
    fewest. A noun of one author is split by pack in the same way. A tenth of the rest is held out, by a hash.

    Parameters
    ----------
    noun_members : list of (path, author, pack)

    Returns
    -------
    dict of path to "prior", "judge" or "held out"
    """
    judges = _fewest(noun_members, 1) or _fewest(noun_members, 2)
    result = {}
    for member in noun_members:
        digest = int.from_bytes(hashlib.sha256(member[0].encode()).digest()[:4])
        rest = HELD_OUT if digest < _HELD_SHARE * 2**32 else PRIOR
        result[member[0]] = JUDGE if judges and judges in member else rest
    return result


def _fewest(members: list[tuple[str, str, str]], column: int) -> str:
    """Return the author (column 1) or pack (2) whose members the judge gets; nothing if there is no other."""
    counts = {name: sum(member[column] == name for member in members) for name in sorted({m[column] for m in members})}
    if len(counts) < 2:
        return ""
    return "Kay Lousberg" if "Kay Lousberg" in counts else min(counts, key=lambda name: counts[name])
