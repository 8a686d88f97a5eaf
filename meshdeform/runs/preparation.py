"""Prepare the asset of a run: leave out nodes and backdrops, weld it, and subdivide it for `output.subdivide`."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.subdivide import MAX_TRIANGLES, Subdivision
from meshdeform.errors import AssetEmptyError, ParameterError
from meshdeform.geometry.weld import WeldedMesh, weld
from meshdeform.requests.choices import BackdropMode
from meshdeform.requests.document import OutputOptions, ResolvedParams
from meshdeform.requests.selection import find_excluded

__all__ = ["drawn_triangles", "prepared", "read_result", "shape_id", "subdivided", "welded_surface"]


def prepared(
    asset: Asset, params: ResolvedParams, output: OutputOptions, limits: Limits | None
) -> tuple[Asset, Subdivision | None]:
    """Return the asset that a run deforms, and what was split if it is subdivided.

    Raises
    ------
    ParameterError
        An excluded node does not exist, or nothing else is left.
    """
    if params.exclude:
        asset = _without(asset, params.exclude)
    return subdivided(asset, limits) if output.subdivide else (asset, None)


def _without(asset: Asset, exclude: Sequence[str | int]) -> Asset:
    try:
        return asset.without(find_excluded(exclude, asset.parts().nodes))
    except AssetEmptyError as error:
        detail = "params.control.exclude: nothing is left to deform."
        raise ParameterError.at(["params", "control", "exclude"], detail, "Exclude fewer nodes.") from error


def drawn_triangles(asset: Asset, backdrop: BackdropMode = BackdropMode.LEAVE) -> NDArray[np.bool_]:
    """Return flags (T,) of the triangles of the surface that are drawn and deformed: all but a backdrop's."""
    found = asset.backdrop
    if found is None or not found.left or backdrop is BackdropMode.DEFORM:
        return np.ones(len(asset.surface.triangles), bool)
    return ~found.triangles


def welded_surface(asset: Asset, backdrop: BackdropMode = BackdropMode.LEAVE) -> WeldedMesh:
    """Weld the triangles that are drawn and deformed.

    Raises
    ------
    AssetEmptyError
        None has an area.
    """
    surface = asset.surface
    return weld(surface.positions, surface.triangles, left_out=~drawn_triangles(asset, backdrop))


def subdivided(asset: Asset, limits: Limits | None) -> tuple[Asset, Subdivision]:
    """Return the asset with its long edges split, within the limits of the deployment, and what was split."""
    return asset.subdivided(min(MAX_TRIANGLES, (limits or Limits()).max_triangles))


def shape_id(asset_sha256: str, asset: Asset, params: ResolvedParams, output: OutputOptions) -> str:
    """Return the id of the mesh that a run deforms; a checkpoint fits only its own."""
    done = ["subdivided"] if output.subdivide else []
    without = [json.dumps(name) for name in params.exclude]
    if not drawn_triangles(asset, params.backdrop).all():
        without.append("backdrop")
    return "+".join([asset_sha256, *done, *without])


def read_result(result: bytes) -> Asset:
    """Read our own `result.glb` back, without the limits for sources."""
    return load_asset(result, "result.glb", Limits.unlimited())
