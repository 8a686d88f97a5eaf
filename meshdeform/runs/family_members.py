"""Make members of a fitted family for a lesson."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence

from meshdeform.assets import Limits
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.runs.family_synthesize import start
from meshdeform.runs.lesson_files import MeshFile

__all__ = ["MADE", "made_members"]

MADE = 60
"""Members that a lesson makes of a family: as many as it draws of a mesh."""


def made_members(family: bytes, files: Sequence[MeshFile], seed: int, limits: Limits | None = None) -> list[MeshFile]:
    """Return `MADE` new shapes of a family; the same seed gives the same shapes.

    Parameters
    ----------
    family : bytes
        The `family.safetensors` of a fit.
    files : sequence of MeshFile
        The collection that was fitted.
    seed : int
    limits : Limits, optional

    Raises
    ------
    AssetError
        The family cannot be read, or the files are not those that it was fitted to.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for file in files:
            archive.writestr(zipfile.ZipInfo(file.name), file.data)
    request = JobRequest.model_validate({"kind": "family_synthesize", "params": {"count": MADE, "seed": seed}})
    given = {
        "family": InputFile(family, "family.safetensors"),
        "collection": InputFile(packed.getvalue(), "collection.zip"),
    }
    run = start(RunInput(request, given, limits=limits))
    for _ in run:
        pass
    return [MeshFile(f"shape_{number:02d}.glb", shape) for number, shape in enumerate(run.shapes)]
