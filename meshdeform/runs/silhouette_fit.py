"""Create the guidance by silhouettes from the pictures and parameters of a job, and measure how well they fit."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any, Self

from torch import Tensor

from meshdeform.assets.silhouette import read_silhouette
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.base import Guidance
from meshdeform.guidance.beside import BesideSilhouettes, SilhouetteGuidance
from meshdeform.guidance.silhouettes import SilhouetteTerm, SilhouetteView
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.silhouettes import SILHOUETTE_PARTS

__all__ = ["SilhouetteFit"]


class SilhouetteFit:
    """The pictures of a job.

    Parameters
    ----------
    params : ResolvedParams
    views : sequence of SilhouetteView
        One for each of `params.guidance.silhouettes`.
    sha256 : str
        Of all pictures.
    """

    def __init__(self, params: ResolvedParams, views: Sequence[SilhouetteView], sha256: str) -> None:
        self._params, self._views, self._sha256 = params, views, sha256

    @classmethod
    def of(cls, params: ResolvedParams, pictures: Sequence[bytes]) -> Self:
        """Read the pictures of a job.

        Raises
        ------
        ParameterError
            A picture is missing.
        SilhouetteError, AssetTooLargeError
            A picture cannot be used.
        """
        if len(pictures) != len(params.silhouettes):
            detail = f"silhouettes has {len(params.silhouettes)} entries, and there are {len(pictures)} pictures."
            raise ParameterError(detail, advice="Give each picture one entry with its azimuth.")
        views = [
            SilhouetteView(read_silhouette(data, f"`{name}`").mask, each.azimuth, each.elevation, each.fov)
            for name, data, each in zip(SILHOUETTE_PARTS, pictures, params.silhouettes, strict=False)
        ]
        return cls(
            params, views, hashlib.sha256(b"".join(hashlib.sha256(data).digest() for data in pictures)).hexdigest()
        )

    def guidance(self, device: str) -> Guidance:
        """Return the guidance by the pictures alone."""
        identity = {"id": "silhouettes", "revision": "", "sha256": self._sha256}
        return SilhouetteGuidance(SilhouetteTerm(self._views, device=device), self._params.silhouette_weight, identity)

    def beside(self, guidance: Guidance, device: str) -> Guidance:
        """Return a guidance by the pictures beside another one."""
        identity = {**guidance.identity, "silhouettes_sha256": self._sha256}
        term = SilhouetteTerm(self._views, device=device)
        return BesideSilhouettes(guidance, term, self._params.silhouette_weight, identity)

    def measure(self, rest: TriangleMesh, verts: Tensor) -> list[dict[str, Any]]:
        """Return `silhouettes` of the report for a result (V, 3) in the cameras' frame."""
        term = SilhouetteTerm(self._views)
        term.begin(rest)
        before, after = term.overlaps(rest.verts), term.overlaps(verts)
        return [
            {
                "part": name,
                **each.model_dump(mode="json"),
                "iou_before": round(first, 4),
                "iou": round(last, 4),
            }
            for name, each, first, last in zip(SILHOUETTE_PARTS, self._params.silhouettes, before, after, strict=False)
        ]
