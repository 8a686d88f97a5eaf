"""Write a new USD layer spec by spec.

`Usd.Stage` would recompose on every attribute, which took seconds for a thousand small meshes.
Source: UsdGeom, UsdShade and UsdSkel schemas (Pixar), which define how their properties are stored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Vt

TYPES = Sdf.ValueTypeNames
PER_SECOND = 60.0
"""Time codes of a second."""
_INVALID = re.compile(r"[^A-Za-z0-9_]")
_MAX_NAME = 120


class Layer:
    """A layer with +Y up, in metres, whose only root prim is the default prim.

    `path`: the `.usdc` file to create; `root`: path of the root prim, of the schema `kind`.
    """

    def __init__(self, path: Path, root: str, kind: str, creator: str) -> None:
        self._layer = Sdf.Layer.CreateNew(str(path))
        top = self._layer.pseudoRoot
        top.SetInfo("upAxis", "Y")
        top.SetInfo("metersPerUnit", 1.0)
        self._layer.defaultPrim = root.strip("/")
        self._prims: dict[str, Sdf.PrimSpec] = {"": top}
        self._taken: set[str] = set()
        self._creator = creator
        self.root = self.prim("", root.strip("/"), kind)
        self._prims[self.root].kind = "component"

    def prim(self, parent: str, wanted: str, kind: str, otherwise: str = "", schemas: Sequence[str] = ()) -> str:
        """Create a prim below one that exists, and return its path.

        `wanted`: the asset's name, of any characters; it is the display name where a prim cannot have it. `otherwise`:
        the name to use if no valid character remains.
        """
        name = valid_name(wanted, otherwise or kind)
        path, number = f"{parent}/{name}", 1
        while path in self._taken:
            number += 1
            path = f"{parent}/{name}_{number}"
        self._taken.add(path)
        made = self._prims[path] = Sdf.PrimSpec(self._prims[parent], path.rpartition("/")[2], Sdf.SpecifierDef, kind)
        if wanted and wanted != made.name:
            # JSON can contain half of a surrogate pair, which cannot be encoded as UTF-8.
            made.SetInfo("displayName", wanted.encode("utf-8", "replace").decode())
        if schemas:
            made.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=list(schemas)))
        return path

    def set(
        self, prim: str, name: str, kind: Any, value: Any = None, *, uniform: bool = False, primvar: str = ""
    ) -> Any:
        """Add an attribute, with a value if given; `primvar`: its interpolation."""
        variability = Sdf.VariabilityUniform if uniform else Sdf.VariabilityVarying
        made = Sdf.AttributeSpec(self._prims[prim], name, kind, variability)
        if value is not None:
            made.default = value
        if primvar:
            made.SetInfo("interpolation", primvar)
        return made

    def link(self, prim: str, name: str, target: str, *more: str) -> None:
        """Add a relationship."""
        made = Sdf.RelationshipSpec(self._prims[prim], name, custom=False)
        made.targetPathList.explicitItems = [target, *more]

    def connect(self, target: Any, source: Any) -> None:
        """Connect an attribute to another one, its source."""
        target.connectionPathList.explicitItems = [source.path]

    def samples(self, made: Any, samples: Mapping[float, Any]) -> None:
        """Give an attribute values at times, in seconds."""
        for seconds, value in samples.items():
            self._layer.SetTimeSample(made.path, PER_SECOND * seconds, value)

    def play(self, start: float, end: float) -> None:
        """Say from when to when the layer plays, in seconds."""
        self._layer.timeCodesPerSecond = self._layer.framesPerSecond = PER_SECOND
        self._layer.startTimeCode, self._layer.endTimeCode = PER_SECOND * start, PER_SECOND * end

    def save(self, told: Sequence[str]) -> None:
        """Write the file, which says who made it and what it leaves out."""
        self._layer.customLayerData = {"creator": self._creator, **({"leftOut": " ".join(told)} if told else {})}
        self._layer.Save()


def valid_name(wanted: str, otherwise: str) -> str:
    """Return an ASCII identifier: other characters become underscores, and a digit in front gets one before it."""
    name = _INVALID.sub("_", wanted)[:_MAX_NAME]
    if not name.strip("_"):
        name = otherwise
    return f"_{name}" if name[0].isdigit() else name


def matrices(values: Sequence[NDArray[np.float64]]) -> Any:
    """Return matrices for column vectors (K, 4, 4) as an array of USD, which multiplies rows."""
    return Vt.Matrix4dArray([matrix(each) for each in values])


def matrix(value: NDArray[np.float64]) -> Any:
    """Return a matrix for column vectors (4, 4) as one of USD."""
    return Gf.Matrix4d(value.T.tolist())


def vectors(rows: NDArray[np.floating]) -> Any:
    """Return rows (N, 3) as an array of 32-bit floats."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows, np.float32))


def integers(values: NDArray[np.integer]) -> Any:
    """Return integers (N,) as an array of 32-bit ones."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


def floats(values: NDArray[np.floating]) -> Any:
    """Return numbers (N,) as an array of 32-bit floats."""
    return Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, np.float32))
