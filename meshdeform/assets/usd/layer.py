"""Write a new USD layer spec by spec.

`Usd.Stage` would recompose on every attribute, which took seconds for a thousand small meshes.
Source: UsdGeom and UsdShade schemas (Pixar), which define how their properties are stored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pxr import Sdf

__all__ = ["Layer", "attribute", "connect"]


class Layer:
    """A layer with +Y up, in metres, whose only root prim is the default prim.

    Parameters
    ----------
    path : Path
        The `.usdc` file to create.
    root : str
        Path of the root prim.
    creator : str
    """

    def __init__(self, path: Path, root: str, creator: str) -> None:
        self._layer = Sdf.Layer.CreateNew(str(path))
        top = self._layer.pseudoRoot
        top.SetInfo("upAxis", "Y")
        top.SetInfo("metersPerUnit", 1.0)
        self._layer.customLayerData = {"creator": creator}
        self._layer.defaultPrim = root.strip("/")
        self._prims: dict[str, Sdf.PrimSpec] = {"": top}
        self.prim(root, "Xform").kind = "component"

    def prim(self, path: str, kind: str, name: str = "") -> Sdf.PrimSpec:
        """Create a prim below one that exists.

        Parameters
        ----------
        path : str
        kind : str
            The prim's schema.
        name : str
            The name in the asset, stored as the display name if it differs.
        """
        parent, _, own = path.rpartition("/")
        made = self._prims[path] = Sdf.PrimSpec(self._prims[parent], own, Sdf.SpecifierDef, kind)
        if name and name != own:
            # JSON can contain half of a surrogate pair, which cannot be encoded as UTF-8.
            made.SetInfo("displayName", name.encode("utf-8", "replace").decode())
        return made

    def save(self) -> None:
        """Write the file."""
        self._layer.Save()


def attribute(
    prim: Sdf.PrimSpec, name: str, kind: Any, value: Any = None, *, uniform: bool = False, interpolation: str = ""
) -> Sdf.AttributeSpec:
    """Add an attribute with a type from `Sdf.ValueTypeNames`, and a value if given."""
    made = Sdf.AttributeSpec(prim, name, kind, Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying)
    if value is not None:
        made.default = value
    if interpolation:
        made.SetInfo("interpolation", interpolation)
    return made


def connect(target: Sdf.AttributeSpec, source: Sdf.AttributeSpec) -> None:
    """Connect an attribute to another one, its source."""
    target.connectionPathList.explicitItems = [source.path]
