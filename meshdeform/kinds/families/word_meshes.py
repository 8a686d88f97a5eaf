"""Take the meshes of a word from a fitted family: some of its members, and shapes drawn between members.

The family's file has no surfaces: they come from the collection that it was fitted to. All are turned alike, and have
the parts that the fit found; those that nobody named (`part 1`) become no parts of the word.
"""

from __future__ import annotations

from pathlib import PurePosixPath

import numpy as np

from meshdeform.assets import Limits, build_glb, load_asset
from meshdeform.assets.parted import PartLabels, with_parts
from meshdeform.assets.surface import Surface
from meshdeform.kinds.families.family_file import FamilyFile
from meshdeform.kinds.families.members import turned
from meshdeform.kinds.families.synthesis_run import start
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import InputFile, RunInput

__all__ = ["family_meshes"]

_MEMBERS, _DRAWN = 24, 8


def family_meshes(family: bytes, collection: bytes, limits: Limits | None = None) -> dict[str, bytes]:
    """Return GLBs by the names that files may have: at most 24 members, spread over the collection, and 8 drawn shapes.

    `family`: the file `family.safetensors` of a fit; `collection`: the ZIP that was fitted, or its `labelled.zip`.
    Raises AssetError: one is damaged, or they do not belong together.
    """
    files = {
        "family": InputFile(family, "family.safetensors"),
        "collection": InputFile(collection, "collection.zip"),
    }
    request = JobRequest.model_validate({"kind": "family_synthesize", "params": {"count": _DRAWN}})
    run = start(RunInput(request, files, limits=limits))
    for _ in run:
        pass
    fitted = run.family
    count = len(fitted.names)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MEMBERS)).round().astype(int)).tolist()
    members = {
        _file_name(fitted.names[number]): _member(run.asset(number).surface, fitted, number) for number in chosen
    }
    return members | {f"drawn-{number}.glb": shape for number, shape in enumerate(run.shapes, 1)}


def _file_name(member: str) -> str:
    """Return the name of a member of a collection as that of a file in no folder."""
    return str(PurePosixPath(member).with_suffix(".glb")).replace("/", "-")


def _member(surface: Surface, family: FamilyFile, number: int) -> bytes:
    """Return the surface of a member with its parts, turned as all are."""
    glb = build_glb(turned(surface.positions, float(family.turns[number])), surface.triangles)
    labels = PartLabels(tuple(family.parts), family.segments[number].astype(np.int64) + 1)
    return with_parts(load_asset(glb), labels)
