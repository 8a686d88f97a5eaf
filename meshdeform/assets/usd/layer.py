"""A new layer, written spec by spec.

Through `Usd.Stage` every attribute would be composed anew: a thousand small meshes took seconds.
Source: UsdGeom and UsdShade schemas (Pixar), which say how their properties are stored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pxr import Sdf

__all__ = ["Layer", "attribute", "connect"]


class Layer:
    """A layer of +Y up and metres, with one root prim that is the default one.

    Parameters
    ----------
    path : Path
        The `.usdc` file to make.
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
        """Make a prim below one that was made before.

        Parameters
        ----------
        path : str
        kind : str
            Its schema.
        name : str
            What the asset calls it, kept as the display name where it differs.
        """
        parent, _, own = path.rpartition("/")
        made = self._prims[path] = Sdf.PrimSpec(self._prims[parent], own, Sdf.SpecifierDef, kind)
        if name and name != own:
            # JSON can say half of a surrogate pair, which no file of text can hold.
            made.SetInfo("displayName", name.encode("utf-8", "replace").decode())
        return made

    def save(self) -> None:
        """Write the file."""
        self._layer.Save()


def attribute(
    prim: Sdf.PrimSpec, name: str, kind: Any, value: Any = None, *, uniform: bool = False, interpolation: str = ""
) -> Sdf.AttributeSpec:
    """Add an attribute of a type out of `Sdf.ValueTypeNames`, with its value where it has one."""
    made = Sdf.AttributeSpec(prim, name, kind, Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying)
    if value is not None:
        made.default = value
    if interpolation:
        made.SetInfo("interpolation", interpolation)
    return made


def connect(target: Sdf.AttributeSpec, source: Sdf.AttributeSpec) -> None:
    """Let an attribute take its value from another one."""
    target.connectionPathList.explicitItems = [source.path]
