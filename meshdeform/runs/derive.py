"""Make `morph.glb`, another format, pose or strength, or a map for other files of a result, in a child process.

This module imports neither torch nor numpy, which only the child needs. The child has no secrets in its environment,
and bounded memory and time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshdeform.assets.limits import Limits
from meshdeform.children.asking import ChildLostError, run_child
from meshdeform.children.protocol import Bounds
from meshdeform.errors import (
    AssetTooLargeError,
    AssetUnsupportedError,
    DependencyError,
    ParameterError,
    UnavailableError,
)
from meshdeform.requests.document import MorphParams, OutputParams
from meshdeform.runs.base import FORMATS_OF_RESULT, RESULT

if TYPE_CHECKING:
    from meshdeform.assets.asset import Asset
    from meshdeform.assets.export import Export
    from meshdeform.assets.surface import Surface

STRENGTH = RESULT
"""The name for `derive` of a result at another strength."""

POSED = "posed.glb"
"""The name for `derive` of a result in a pose."""

ALIKE = "alike.glb"
"""The name for `derive` of another file that is deformed as an asset was: give it and the map."""

_WIDER = 16
"""How much larger an artifact may be than the largest asset."""

_BASE_BYTES = {
    "morph.glb": 16 * 2**30,
    **dict.fromkeys(("result.obj.zip", "result.3mf", "result.stl", POSED), 2 * 2**30),
    "result.usdz": 8 * 2**30,
    "map.safetensors": 16 * 2**30,
    STRENGTH: 16 * 2**30,
    ALIKE: 16 * 2**30,
}
"""Address space beyond that of two checks: torch maps several gigabytes, whatever it does."""

_APPLIED = {STRENGTH: "strength", ALIKE: "map", POSED: "pose"}
"""What is applied to make those that are no artifacts."""

_WITHOUT_UNIT = (".3mf", ".obj", ".ply", ".stl")
"""Endings of assets whose unit nobody knows."""

_SECONDS = 2.0
"""The time limit, relative to that of a check."""
OF_RESULT = frozenset(kind.name for kind in FORMATS_OF_RESULT)
"""The artifacts that are made of `result.glb` alone."""
DERIVED = frozenset({"morph.glb", "map.safetensors", *OF_RESULT})
"""The artifacts that can be made afterwards."""


class DerivedInput:
    """The files from which an artifact is made.

    `source` and `result`: the asset and the `result.glb` of the same job. A name in `OF_RESULT` needs no asset: name
    the result twice. `filename`: the name that the user gave the asset; `output`: those of the job's request;
    `exclude`: `params.control.exclude` of the run; `strength`: of `STRENGTH` only: 0 is the source, 1 the result;
    `outside`: of `ALIKE` only: of pieces that reach out of what the map deforms. `pose`: of `POSED` and `OF_RESULT`
    only: `CLIP@SECONDS`.
    """

    def __init__(
        self,
        source: Path,
        result: Path,
        filename: str,
        output: OutputParams,
        exclude: Sequence[str | int] = (),
        strength: float = 1.0,
        outside: str = "refuse",
        pose: str | None = None,
    ) -> None:
        self.source, self.result, self.filename = source.absolute(), result.absolute(), filename
        self.output, self.exclude, self.strength, self.outside = output, list(exclude), strength, outside
        self.pose = pose

    @property
    def size(self) -> int:
        """The number of bytes of both files."""
        return self.source.stat().st_size + self.result.stat().st_size


def derive(name: str, job_input: DerivedInput, target: Path, limits: Limits | None = None) -> list[str]:
    """Make an artifact in a child process; return sentences about what its format cannot hold.

    `name`: one of `DERIVED`, `STRENGTH`, `POSED` or `ALIKE`. `target`: the file to write; its folder also takes the
    child's temporary files.
    """
    limits = limits or Limits()
    seconds = _SECONDS * limits.max_check_s
    given = {
        "name": name,
        "source": str(job_input.source),
        "result": str(job_input.result),
        "target": str(target.absolute()),
        "limits": asdict(limits),
        "filename": job_input.filename,
        "compact": job_input.output.compact,
        "provenance": job_input.output.provenance,
        "morph_path": job_input.output.morph_path.model_dump(mode="json"),
        "exclude": job_input.exclude,
        "strength": job_input.strength,
        "outside": job_input.outside,
        "pose": job_input.pose,
    }
    memory = _BASE_BYTES[name] + 2 * limits.memory_bytes(job_input.size)
    bounds = Bounds(memory, seconds, _WIDER * limits.max_bytes)
    try:
        warnings: list[str] = run_child("derive", given, bounds, temporary=target.absolute().parent)
    except TimeoutError as error:
        raise _too_much(name, f"within {seconds:g} s") from error
    except ChildLostError as error:
        raise _too_much(name, "with the memory and time that it may use") from error
    return warnings


def _too_much(name: str, how: str) -> AssetTooLargeError | UnavailableError:
    if name in _APPLIED:
        what = _APPLIED[name]
        return UnavailableError(
            f"The {what} could not be applied {how} on this server.",
            advice=f"Download the files, and run `meshdeform {'convert' if name == POSED else 'apply'}`.",
        )
    return AssetTooLargeError(
        f"{name} could not be made {how}.", advice="Request it with the job, or make it from the downloaded files."
    )


def derive_given(given: dict[str, Any]) -> list[str]:
    """Make one artifact, in the child; return sentences about what its format cannot hold."""
    limits, warnings = Limits(**given["limits"]), list[str]()
    name, source, result = given["name"], Path(given["source"]), Path(given["result"])
    if name in _MAKERS:
        data = _MAKERS[name](source, result, given, limits)
    else:
        exported = _exported(name, result, given)
        data, warnings = exported.data, list(exported.warnings)
    Path(given["target"]).write_bytes(data)
    return warnings


def _morph(source: Path, result: Path, options: dict[str, Any], limits: Limits) -> bytes:
    from meshdeform.assets.asset import load_asset

    asset = load_asset(source.read_bytes(), options["filename"], limits)
    end = load_asset(result.read_bytes(), limits=Limits.unlimited())
    written = {"compact": options["compact"], "provenance": end.provenance if options["provenance"] else None}
    if find_spec("torch") is None:
        # The shapes between need the solve, and the service's image has no torch.
        return _straight(asset, end.surface, written)
    from meshdeform.runs.strength import AssetPath, matched, write_morph

    try:
        asset, end = matched(asset, end, options["exclude"], limits)
    except ParameterError as error:
        raise _other_triangles() from error
    path = AssetPath(asset, end.surface.positions)
    return write_morph(asset, path, path.at(1), MorphParams.model_validate(options["morph_path"]), **written)


def _straight(asset: Asset, end: Surface, written: dict[str, Any]) -> bytes:
    """Return a morph with the result as its only target."""
    if asset.surface.triangles.tobytes() != end.triangles.tobytes():
        raise _other_triangles()
    return asset.replace(end.positions, end.normals, end.tangents, morph=True, **written)


def _other_triangles() -> AssetUnsupportedError:
    return AssetUnsupportedError(
        "morph.glb cannot be made afterwards: result.glb has other triangles than the asset.",
        advice="Post a new job with output.morph.",
    )


def _exported(name: str, result: Path, options: dict[str, Any]) -> Export:
    """Write a result in the format that an artifact's name says."""
    from meshdeform.assets.asset import load_asset
    from meshdeform.assets.export import export
    from meshdeform.assets.pose import Pose

    asset = load_asset(result.read_bytes(), limits=Limits.unlimited())
    if options["filename"].endswith(_WITHOUT_UNIT):
        asset.unit = None
    return export(asset, name, pose=Pose.parse(options["pose"]) if options["pose"] else None)


def _to_change(file: Path, options: dict[str, Any], limits: Limits) -> Asset:
    """Read an asset to apply a strength or a map to, which needs torch."""
    from meshdeform.assets.asset import load_asset

    if find_spec("torch") is None:
        raise DependencyError(
            "Other strengths and maps need the extra `deform` where they are made.",
            advice="Download the result and its source, and run `meshdeform apply`, or install the extra.",
        )
    return load_asset(file.read_bytes(), options["filename"], limits)


def _strength(source: Path, result: Path, options: dict[str, Any], limits: Limits) -> bytes:
    asset = _to_change(source, options, limits)
    from meshdeform.runs.strength import with_strength

    arguments = {"exclude": options["exclude"], "limits": limits, "compact": options["compact"]}
    return with_strength(asset, result.read_bytes(), options["strength"], **arguments)


def _map(source: Path, result: Path, options: dict[str, Any], limits: Limits) -> bytes:
    asset = _to_change(source, options, limits)
    from meshdeform.runs.strength import edit_of

    return edit_of(asset, result.read_bytes(), exclude=options["exclude"], limits=limits).to_bytes()


def _alike(file: Path, edit: Path, options: dict[str, Any], limits: Limits) -> bytes:
    asset = _to_change(file, options, limits)
    from meshdeform.deformation.edit_map import EditMap, Outside
    from meshdeform.runs.strength import with_edit

    return with_edit(asset, EditMap.read(str(edit)), Outside(options["outside"]), compact=options["compact"])


_MAKERS: dict[str, Callable[[Path, Path, dict[str, Any], Limits], bytes]] = {
    "morph.glb": _morph,
    "map.safetensors": _map,
    STRENGTH: _strength,
    ALIKE: _alike,
}
