"""Keep the assets of the last runs of this process, read and welded: another prompt for one need not read it again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.subdivide import Subdivision
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.document import OutputParams, ResolvedParams
from meshdeform.runs.base import InputFile
from meshdeform.runs.surfaces import drawn_triangles, prepared, welded_surface
from meshdeform.support.recent import Recent

__all__ = ["Opened", "opened"]

_MOST, _MOST_BYTES = 16, 512 * 2**20
_BYTES_PER_BYTE, _BYTES_PER_TRIANGLE = 2, 600
"""What an asset takes: by the bytes of its file, of which a part is decoded, and for its surface and its mesh."""
_recent: Recent[Opened] = Recent(_MOST, _MOST_BYTES)


@dataclass(frozen=True)
class Opened:
    """An asset as a run deforms it, what was split if it is subdivided, and its mesh; none of it is ever changed.

    `drawn` (T,): the triangles of the surface that are drawn and deformed.
    """

    asset: Asset
    division: Subdivision | None
    drawn: NDArray[np.bool_]
    welded: WeldedMesh


def opened(file: InputFile, params: ResolvedParams, output: OutputParams, limits: Limits | None) -> Opened:
    """Read, prepare and weld an asset, or return that of a run before; raises what `load_asset` does."""
    suffix = PurePath(file.filename).suffix.lower()
    key = file.digest, suffix, tuple(params.exclude), params.backdrop, output.subdivide, limits
    found = _recent.get(key)
    if found is None:
        loaded = load_asset(file.data, file.filename, limits)
        asset, division = prepared(loaded, params, output, limits)
        found = Opened(asset, division, drawn_triangles(asset, params.backdrop), welded_surface(asset, params.backdrop))
        size = _BYTES_PER_BYTE * len(file.data) + _BYTES_PER_TRIANGLE * len(asset.surface.triangles)
        _recent.put(key, found, size)
    return found
