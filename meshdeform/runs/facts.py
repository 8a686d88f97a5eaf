"""Facts that the runs of kind `text_deform` share: about the asset, about what guides the run, and about its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.subdivide import Subdivision
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import SILHOUETTE_FIELDS
from meshdeform.runs.base import InputFile
from meshdeform.runs.control import AssetControl, WeldedSurface, read_control
from meshdeform.runs.fits import SilhouetteFit
from meshdeform.runs.prompts import Prompts, read_prompts
from meshdeform.runs.surfaces import Shown

if TYPE_CHECKING:
    from meshdeform.reading import Reading

__all__ = ["AssetFacts", "GuidedFacts", "Held", "Outcome", "Wanted"]


@dataclass(frozen=True)
class AssetFacts:
    """Facts about a request and its asset."""

    request: JobRequest
    params: ResolvedParams
    file: InputFile  # the asset, with its hash
    asset: Asset  # the same, prepared
    subdivision: Subdivision | None  # what was split
    drawn: NDArray[np.bool_]  # (T,) bool: which triangles of the asset are drawn and deformed
    welded: WeldedMesh
    device: str


@dataclass(frozen=True)
class GuidedFacts(AssetFacts):
    """Facts about a run before its first step, where prompts, targets or pictures say what the shape becomes."""

    frame: CameraFrame
    # Of the mesh, and of the run
    shape_id: str
    fingerprint: str
    control: AssetControl
    prompts: Prompts | None  # those of a job that has several
    silhouettes: SilhouetteFit | None
    reading: Reading | None  # what the source was read as, if anything depends on it


@dataclass(frozen=True)
class Wanted:
    """What a request says of the shape of a mesh at rest in the cameras' frame, but for its goal.

    `prompts`: those of a job that has several.
    """

    control: AssetControl
    prompts: Prompts | None
    silhouettes: SilhouetteFit | None

    @classmethod
    def of(cls, facts: AssetFacts, frame: CameraFrame, mesh: RestMesh, files: Mapping[str, InputFile]) -> Self:
        """Read the controls, the prompts and the pictures of a request."""
        params, surface = facts.params, WeldedSurface(facts.asset, facts.welded)
        control = read_control(params, surface, frame, mesh)
        several = bool(params.prompts)
        prompts = read_prompts(facts.request.prompt, params, surface, mesh, control) if several else None
        names = [name for name in SILHOUETTE_FIELDS[: len(params.silhouettes)] if name in files]
        pictures = SilhouetteFit.of(params, [files[name].data for name in names]) if params.silhouettes else None
        return cls(control, prompts, pictures)


@dataclass(frozen=True)
class Outcome:
    """Results of a run."""

    verts: NDArray[np.float64]  # (V, 3) float64: deformed welded world positions
    result: bytes  # `result.glb`
    written: Asset  # `result.glb`, read back, so that errors of the writer show
    shown: Shown  # what viewers show of source and result
    rebuilt_normals: int
    """Normals that were replaced, since they would have pointed behind a face. The report adds those that the file had
    without a direction."""
    held: Held


@dataclass(frozen=True)
class Held:
    """Shares of the faces, or of the cells of a lattice, that the safeguard held back when it checked."""

    mean: float = 0.0  # over the run
    at_end: float = 0.0  # over its last quarter

    @classmethod
    def of(cls, shares: Mapping[int, float], steps: int) -> Self:
        """Return the means of the shares at each check, by its step, of a run of so many steps.

        An attempt that resumed before the last quarter says the same of the end as one that did not.
        """
        late = [share for step, share in shares.items() if step > 0.75 * steps] or list(shares.values())[-1:]
        return cls(float(np.mean(list(shares.values()))), float(np.mean(late))) if shares else cls()
