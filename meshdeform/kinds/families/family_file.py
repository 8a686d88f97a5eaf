"""Read and write `family.safetensors`: what a fit has found about a family, as arrays that nothing executes.

The file holds the machine and the template, and for each member the places of the template's points, the part of each
triangle, and a digest of the surface, by which the member's asset is recognised. Without torch: the check uses it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.limits import Limits
from meshdeform.assets.surface import Surface
from meshdeform.errors import AssetError, AssetFormatError, AssetNotFiniteError, AssetTruncatedError

FAMILY_FORMAT = "meshdeform-family-3"
_ANY_VERSION = "meshdeform-family-"
_MAX_HEADER_BYTES = 16 * 2**20
_MOST_POINTS, _MOST_MEMBERS, _MOST_PARTS = 1000, 3000, 16
_FARTHEST, _LEAST_SIZE, _STRONGEST = 2.0, 1e-3, 1e6
"""Bounds of the frame, whose diagonal is 1, and of the weights; a fit stays far inside them."""
_AGAIN = "Run family_fit again, and use the family.safetensors that it writes."
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class FamilyFile:
    """A fitted family of T members with K template points and L parts."""

    names: list[str]  # members, as the collection names them
    parts: list[str]
    digests: list[str]  # `surface_digest` of each member
    machine: Arrays  # the weights of the Beta shape machine, and `sees`
    labels: NDArray[np.int64]  # (K,) int64: the part of each point
    scaling: NDArray[np.float32]  # (4,) float32: from frame to machine: lowest x, y, z, and size
    points: NDArray[np.float64]
    """(T, K, 3) float64: places on the members, in the frame: the middle of the bounding box at 0, its diagonal as
    unit, turned alike."""
    triangles: NDArray[np.int64]  # (T, K) int64
    exists: NDArray[np.bool_]  # (T, K) bool
    # From the frame to the file: turn by -`turns` around +Y, times the diagonal, plus the centre.
    centres: NDArray[np.float64]  # (T, 3) float64
    diagonals: NDArray[np.float64]  # (T,) float64
    turns: NDArray[np.float64]  # (T,) float64
    segments: list[NDArray[np.uint8]]  # list of (F,) uint8: the part of each triangle of each member

    def member(self, name: str) -> int | None:
        """Return the number of a member by its name in the collection, its file name, or that without its ending."""
        for of in (str, lambda n: PurePosixPath(n).name, lambda n: PurePosixPath(n).stem):
            numbers = [number for number, each in enumerate(self.names) if of(each) == name]
            if len(numbers) == 1:
                return numbers[0]
        return None


def surface_digest(surface: Surface) -> str:
    """Return the SHA-256 of the corners of the triangles.

    It is the same for a copy of an asset with other attributes, or with vertices that were split.
    """
    return hashlib.sha256(np.ascontiguousarray(surface.positions[surface.triangles], "<f8").tobytes()).hexdigest()


def has_digest(surface: Surface, digest: str) -> bool:
    """Return whether a surface has a digest, also one as earlier versions wrote it: of positions and triangles."""
    earlier = hashlib.sha256(np.ascontiguousarray(surface.positions, "<f8").tobytes())
    earlier.update(np.ascontiguousarray(surface.triangles, "<i8").tobytes())
    return digest in (surface_digest(surface), earlier.hexdigest())


def dump_family(family: FamilyFile, more: Arrays) -> bytes:
    """Write the file; `more` is kept in it for readers of other programs."""
    from safetensors.numpy import save

    counts = np.array([len(each) for each in family.segments], np.int64)
    arrays: Arrays = {f"machine.{name}": value for name, value in family.machine.items()}
    arrays |= {"template.labels": family.labels, "scaling": family.scaling, **more}
    for name in ("points", "triangles", "exists", "centres", "diagonals", "turns"):
        arrays[f"members.{name}"] = getattr(family, name)
    arrays |= {"members.segments": np.concatenate(family.segments), "members.triangle_counts": counts}
    about = {"names": family.names, "parts": family.parts, "digests": family.digests}
    metadata = {"format": FAMILY_FORMAT, **{name: json.dumps(value) for name, value in about.items()}}
    return save({name: np.ascontiguousarray(value) for name, value in arrays.items()}, metadata)


def read_family(data: bytes, limits: Limits | None = None) -> FamilyFile:
    """Read a family and check that everything in it fits together.

    Raises AssetError: it is damaged, too large, of another version, or no family; the message says what to do.
    """
    limits = limits or Limits()
    limits.check_bytes(len(data))
    metadata, arrays = _load(data)
    try:
        names, parts, digests = (_strings(metadata, name) for name in ("names", "parts", "digests"))
        machine = {name[8:]: arrays.pop(name) for name in list(arrays) if name.startswith("machine.")}
        family = FamilyFile(
            names=names,
            parts=parts,
            digests=digests,
            machine=machine,
            labels=arrays["template.labels"],
            scaling=arrays["scaling"],
            points=arrays["members.points"],
            triangles=arrays["members.triangles"],
            exists=arrays["members.exists"],
            centres=arrays["members.centres"],
            diagonals=arrays["members.diagonals"],
            turns=arrays["members.turns"],
            segments=_split(arrays["members.segments"], arrays["members.triangle_counts"]),
        )
        _check(family)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        detail = f"The family does not fit together: {str(error)[:120]}."
        raise AssetError(detail, advice=_AGAIN) from error
    return family


def _load(data: bytes) -> tuple[dict[str, str], Arrays]:
    advice = f"Send the file family.safetensors. {_AGAIN}"
    length = int.from_bytes(data[:8], "little")
    if len(data) < 8 or length > min(len(data) - 8, _MAX_HEADER_BYTES):
        raise AssetFormatError("The file is not a safetensors file.", advice=advice)
    try:
        header = json.loads(data[8 : 8 + length])
        metadata = header.get("__metadata__") or {}
        version = str(metadata.get("format", ""))
    except (ValueError, AttributeError, RecursionError) as error:
        raise AssetFormatError("The file is not a safetensors file.", advice=advice) from error
    if version != FAMILY_FORMAT:
        detail = "The file holds no family."
        if version.startswith(_ANY_VERSION):
            detail = f"The family has the format {version[:40]!r}; this version reads {FAMILY_FORMAT!r}."
        raise AssetFormatError(detail, advice=_AGAIN)
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return metadata, load(data)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise AssetTruncatedError("The family file is damaged or incomplete.", advice=_AGAIN) from error


def _strings(metadata: dict[str, str], name: str) -> list[str]:
    strings = json.loads(metadata[name])
    if not isinstance(strings, list) or not all(isinstance(each, str) and len(each) <= 4096 for each in strings):
        raise ValueError(f"{name} is no list of names")
    return strings


def _split(values: NDArray[Any], counts: NDArray[Any]) -> list[NDArray[np.uint8]]:
    if values.dtype != np.uint8 or counts.dtype != np.int64 or counts.ndim != 1 or (counts < 1).any():
        raise ValueError("the parts of triangles are of another type")
    if values.ndim != 1 or int(counts.sum()) != len(values):
        raise ValueError("the parts of triangles have another number")
    return np.split(values, np.cumsum(counts)[:-1])


def _check(family: FamilyFile) -> None:
    """Refuse shapes that do not fit, indices out of range and values that are not finite."""
    count, members, parts = len(family.labels), len(family.names), len(family.parts)
    if not (3 <= count <= _MOST_POINTS and 2 <= members <= _MOST_MEMBERS and 2 <= parts <= _MOST_PARTS):
        raise ValueError("it has too few or too many points, members or parts")
    if len(set(family.names)) < members or len(set(family.parts)) < parts:
        raise ValueError("a name is there twice")
    hidden = family.machine["w1"].shape[0], family.machine["w2"].shape[0], family.machine["w3"].shape[0]
    latent = family.machine["g0"].shape[0]
    expected: dict[str, tuple[NDArray[Any], tuple[int, ...], str]] = {
        "labels": (family.labels, (count,), "int64"),
        "scaling": (family.scaling, (4,), "float32"),
        "points": (family.points, (members, count, 3), "float64"),
        "triangles": (family.triangles, (members, count), "int64"),
        "exists": (family.exists, (members, count), "bool"),
        "centres": (family.centres, (members, 3), "float64"),
        "diagonals": (family.diagonals, (members,), "float64"),
        "turns": (family.turns, (members,), "float64"),
    }
    visible = (3 * count, hidden[0])
    shapes: dict[str, tuple[int, ...]] = {
        **dict.fromkeys(("a0", "b0", "m0", "m1"), visible[:1]),
        **dict.fromkeys(("a", "b", "c", "d", "sees"), visible),
        "w1": hidden[:1],
        "w2": hidden[1:2],
        "w3": hidden[2:],
        "w12": hidden[:2],
        "w23": hidden[1:],
        "e0": (count,),
        "g0": (latent,),
        "eg": (count, latent),
    }
    expected |= {name: (family.machine[name], shape, "float32") for name, shape in shapes.items()}
    for name, (values, shape, kind) in expected.items():
        if values.shape != shape or values.dtype != np.dtype(kind):
            raise ValueError(f"{name} has another shape or type")
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise AssetNotFiniteError(f"The family has values of {name} that are not finite.", advice=_AGAIN)
    if len(family.segments) != members or len(family.digests) != members:
        raise ValueError("members are missing")
    every: tuple[NDArray[Any], ...] = (family.labels, *family.segments)
    if any(each.min() < 0 or each.max() >= parts for each in every):
        raise ValueError("a part has no name")
    faces = np.array([len(each) for each in family.segments])[:, None]
    if (family.triangles < 0).any() or (family.triangles >= faces).any():
        raise ValueError("a place names no triangle")
    if not (family.diagonals > 0).all():
        raise ValueError("a size is not positive")
    if np.abs(family.points).max() > _FARTHEST:
        raise ValueError("points lie outside the frame")
    if np.abs(family.scaling).max() > _FARTHEST or family.scaling[3] < _LEAST_SIZE:
        raise ValueError("the frame's size is out of range")
    if wrong := [name for name in shapes if np.abs(family.machine[name]).max() > _STRONGEST]:
        raise ValueError(f"{wrong[0]} of the machine is out of range")
    if min(float(family.machine[name].min()) for name in ("a0", "b0", "a", "b", "c", "d")) < 0:
        raise ValueError("an exponent is negative")
