"""List the morph targets and joints of the deformed meshes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block

__all__ = ["Rig", "read_rig", "rig_accessors"]


@dataclass(frozen=True)
class Rig:
    """What a surface has that would have to follow it.

    Attributes
    ----------
    joints : int
        Joints of its skins.
    morph_targets : int
        Morph targets of its meshes; each counts once however many primitives have it.
    animations : int
        Animations in the file.
    """

    joints: int
    morph_targets: int
    animations: int

    def __bool__(self) -> bool:
        return bool(self.joints or self.morph_targets)


def read_rig(document: Document, blocks: Sequence[Block]) -> Rig:
    """Count what the deformed meshes have."""
    nodes, skins, meshes = document.root["nodes"], document.root.get("skins", []), document.root["meshes"]
    used = {nodes[block.node]["skin"] for block in blocks if "skin" in nodes[block.node]}
    joints = {joint for skin in used for joint in skins[skin]["joints"]}
    shown = {block.mesh for block in blocks}
    targets = sum(max(len(each.get("targets", [])) for each in meshes[mesh]["primitives"]) for mesh in shown)
    return Rig(len(joints), targets, len(document.root.get("animations", [])))


def rig_accessors(document: Document, blocks: Sequence[Block]) -> Iterator[int]:
    """Yield the accessors of their morph targets and inverse bind matrices."""
    nodes = document.root["nodes"]
    for block in blocks:
        for number in block.primitives:
            for target in document.root["meshes"][block.mesh]["primitives"][number].get("targets", []):
                yield from (target[name] for name in ("POSITION", "NORMAL", "TANGENT") if name in target)
        if "skin" in nodes[block.node]:
            skin = document.root["skins"][nodes[block.node]["skin"]]
            if "inverseBindMatrices" in skin:
                yield skin["inverseBindMatrices"]
