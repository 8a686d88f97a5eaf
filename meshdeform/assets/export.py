"""Write an asset in the formats that other programs read, at rest or in a pose, and say what they cannot hold.

This module needs no numpy until it writes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from meshdeform.assets.pose import Pose
from meshdeform.errors import DependencyError, ParameterError, install_command
from meshdeform.support.files import zipped

if TYPE_CHECKING:
    from meshdeform.assets.asset import Asset
    from meshdeform.assets.build import Up
    from meshdeform.assets.frame import FileFrame, Unit
    from meshdeform.assets.scene import Scene

WRITTEN = (".glb", ".usdz", ".obj", ".obj.zip", ".3mf", ".stl")
"""The endings of what is written."""

_WITH_AXIS = (".stl", ".obj", ".obj.zip")
_WITH_UNIT = (*_WITH_AXIS, ".3mf")
_ELSEWHERE = {
    ".fbx": "No library under a permissive licence writes FBX with rigs.",
    ".ply": "PLY is read, but not written.",
    ".usd": "Of USD, packages are written, which hold their textures.",
    ".usda": "Of USD, packages are written, which hold their textures.",
    ".usdc": "Of USD, packages are written, which hold their textures.",
}
_AS_IT_IS = (".glb", ".usdz")


@dataclass(frozen=True)
class Export:
    """An asset in another format.

    `files`: by their names; the first is the one that was asked for, and others are those that it names. `facts`: what
    is known of it, as JSON. `warnings`: sentences about what the format cannot hold, and what its numbers mean.
    """

    files: dict[str, bytes]
    facts: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def data(self) -> bytes:
        """The file that was asked for."""
        return next(iter(self.files.values()))


def ending_of(name: str) -> str:
    """Return the ending of a file's name that says its format, such as `.usdz` or `.obj.zip`.

    Raises ParameterError: nothing is written with that ending.
    """
    lower = name.lower()
    found = max((ending for ending in WRITTEN if lower.endswith(ending)), key=len, default="")
    if found:
        return found
    last = f".{lower.rpartition('.')[2]}" if "." in lower else ""
    why = _ELSEWHERE.get(last, f"{name!r} ends in nothing that is written.")
    raise ParameterError(why, advice=f"Choose {', '.join(WRITTEN)}. Blender makes others of the GLB.")


def export(
    asset: Asset, name: str, *, pose: Pose | None = None, up: Up | None = None, unit: Unit | None = None
) -> Export:
    """Write an asset in the format that the ending of a file's name says.

    Parameters
    ----------
    asset : Asset
    name : str
        A name that ends in one of `WRITTEN`; files beside it are named after it.
    pose : Pose, optional
        A moment of an animation to bake: then there are no skins, morph targets and animations. Default: the pose of
        the nodes. GLB and USDZ keep the rig then; all others show the pose.
    up, unit : optional
        Of STL and OBJ, the axis that points up, `y` or `z`, and of these and 3MF the unit of lengths, `m`, `cm` or
        `mm`. Default: y and m, as in glTF; for 3MF millimetres, with +Z up always. Lengths of an asset whose format
        has no unit (`Asset.unit`) are written as they are, and 3MF calls them its unit.

    Raises
    ------
    ParameterError
        Unknown ending; an axis or unit that the format does not have; no such clip or time.
    DependencyError
        USDZ needs the extra `usd`.
    AssetEmptyError
        Nothing is shown.
    """
    from meshdeform.assets.frame import FileFrame
    from meshdeform.assets.scene import Scene

    ending = ending_of(name)
    for what, value, having in (("axis", up, _WITH_AXIS), ("unit", unit, _WITH_UNIT)):
        if value is not None and ending not in having:
            raise ParameterError(f"{ending} files have one {what}.", advice=f"Choose it for {', '.join(having)} only.")
    require_writer(ending)
    said: list[str] = []
    if pose is None and ending in _AS_IT_IS:
        document = asset.document()
    else:
        document, said = asset.baked(pose)
    if ending == ".glb":
        data = asset.to_bytes() if pose is None else asset.packed(document)
        said = said or list(asset.summary.warnings)
        return Export({name: data}, {"triangles": len(asset.surface.triangles)}, tuple(said))
    printed = ending == ".3mf"
    frame = FileFrame(up or ("z" if printed else "y"), unit or ("mm" if printed else "m"), asset.unit)
    scene = Scene(document)
    files, facts = _WRITERS[ending](scene, frame, name)
    if asset.unit is None:
        unit_said = {".usdz": ", as m", ".3mf": f", as {frame.unit}"}.get(ending, "")
        said.append(f"The source says no unit: its numbers are written as they are{unit_said}.")
    return Export(files, facts, (*said, *scene.sentences()))


def require_writer(ending: str) -> None:
    """Raise DependencyError if what writes a format is not installed."""
    if ending == ".usdz" and find_spec("pxr") is None:
        raise DependencyError(
            "USDZ is written with usd-core, which is not installed here.",
            advice=f"Install it: {install_command('usd')}",
        )


def _obj(scene: Scene, frame: FileFrame, name: str) -> tuple[dict[str, bytes], dict[str, Any]]:
    from meshdeform.assets.obj_file import write_obj

    files, triangles = write_obj(scene, frame, name[: -len(".obj")])
    return files, {"triangles": triangles}


def _zipped_obj(scene: Scene, frame: FileFrame, name: str) -> tuple[dict[str, bytes], dict[str, Any]]:
    files, facts = _obj(scene, frame, name[: -len(".zip")])
    return {name: zipped(files)}, facts


def _stl(scene: Scene, frame: FileFrame, name: str) -> tuple[dict[str, bytes], dict[str, Any]]:
    from meshdeform.assets.stl_file import write_stl

    stl = write_stl(scene, frame)
    return {name: stl.data}, {"triangles": stl.triangles, "closed": stl.closed, "origin": list(stl.origin)}


def _3mf(scene: Scene, frame: FileFrame, name: str) -> tuple[dict[str, bytes], dict[str, Any]]:
    from meshdeform.assets.threemf_file import write_3mf

    data, triangles = write_3mf(scene, frame)
    return {name: data}, {"triangles": triangles}


def _usdz(scene: Scene, frame: FileFrame, name: str) -> tuple[dict[str, bytes], dict[str, Any]]:
    from meshdeform.assets.usd.package import write_usdz

    data, triangles = write_usdz(scene, frame.metres or 1.0)
    return {name: data}, {"triangles": triangles}


_WRITERS: dict[str, Callable[[Scene, FileFrame, str], tuple[dict[str, bytes], dict[str, Any]]]] = {
    ".usdz": _usdz,
    ".obj": _obj,
    ".obj.zip": _zipped_obj,
    ".3mf": _3mf,
    ".stl": _stl,
}
