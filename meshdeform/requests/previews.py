"""Write and read the shapes of a preview: the positions of a result's vertices, quantised. Pure Python.

A file of little-endian numbers: `MDPV`, the version (uint32), the length of the header (uint32), the header as JSON,
padded with spaces to a multiple of 4; then for each shape and each primitive of the result its vertices, three uint16
each, padded to a multiple of 4. With the `low` l and the `step` s of the primitive, a coordinate is l + s q: within
half a step, a 131,070th of the primitive's box, of what `result.glb` has.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from meshdeform.errors import AssetError

__all__ = ["MEDIA_TYPE", "MOST_LEVELS", "PreviewShape", "PreviewShapes", "PrimitivePositions", "pack"]

MEDIA_TYPE = "application/vnd.meshdeform.positions"
MOST_LEVELS = 65535
"""Largest quantised coordinate."""
_MAGIC, _VERSION, _HEAD = b"MDPV", 1, struct.Struct("<4sII")


@dataclass(frozen=True)
class PrimitivePositions:
    """The positions of one primitive of `result.glb`, in its mesh's space.

    `mesh`, `primitive`: its place in the file; `low`, `step`: of the quantisation; `values`: three uint16 a vertex,
    little-endian.
    """

    mesh: int
    primitive: int
    low: tuple[float, float, float]
    step: tuple[float, float, float]
    values: bytes

    @property
    def points(self) -> list[tuple[float, float, float]]:
        """The positions of the vertices, in their order in the file."""
        (x, y, z), (dx, dy, dz) = self.low, self.step
        return [(x + dx * a, y + dy * b, z + dz * c) for a, b, c in struct.iter_unpack("<3H", self.values)]


@dataclass(frozen=True)
class PreviewShape:
    """What the asset becomes with one seed.

    `member`: what it was fitted to, as in a report; `warnings`: sentences about what of the prompt was read
    otherwise, or made less of. What only a measurement of the whole result finds, the report of a job adds.
    """

    seed: int
    primitives: list[PrimitivePositions]
    member: dict[str, Any]
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class PreviewShapes:
    """The shapes of a preview.

    `asset`: SHA-256 of the asset, by which the next preview may name it; `change`: whether the prompt is a change in
    plain words, which is the same with all seeds; `reading`: what the asset was read as, as in a report, or None;
    `draft`: whether the fits were left unmended, of a large asset those of a simplified surface, which it followed.
    """

    asset: str
    change: bool
    reading: dict[str, Any] | None
    shapes: list[PreviewShape]
    draft: bool = False

    @classmethod
    def read(cls, data: bytes) -> PreviewShapes:
        """Read the file that `pack` wrote; AssetError: it is not one, or of another version."""
        try:
            magic, version, length = _HEAD.unpack_from(data)
            if magic != _MAGIC or version != _VERSION:
                raise AssetError("The preview is not of a known version.", advice="Use a client of the same version.")
            start = _HEAD.size + length
            header = json.loads(data[_HEAD.size : start])
            shapes = [_shape(each, header["primitives"], data[start:]) for each in header["shapes"]]
            return cls(header["asset"], header["change"], header["reading"], shapes, header["draft"])
        except (struct.error, ValueError, KeyError, TypeError, IndexError) as error:
            raise AssetError("The preview is cut off or damaged.", advice="Ask for it again.") from error


def _shape(told: Mapping[str, Any], primitives: Sequence[Mapping[str, int]], blocks: bytes) -> PreviewShape:
    found, at = [], told["offset"]
    for each, low, step in zip(primitives, told["low"], told["step"], strict=True):
        values = blocks[at : at + 6 * each["vertices"]]
        if len(values) != 6 * each["vertices"]:
            raise ValueError("a block is cut off")
        found.append(PrimitivePositions(each["mesh"], each["primitive"], tuple(low), tuple(step), values))
        at += _padded(len(values))
    return PreviewShape(told["seed"], found, told["member"], list(told.get("warnings", ())))


def pack(preview: PreviewShapes) -> bytes:
    """Return the file of a preview; shapes whose positions are the same bytes are written once."""
    first = preview.shapes[0].primitives if preview.shapes else []
    blocks, offsets, shapes = b"", dict[bytes, int](), []
    for shape in preview.shapes:
        block = b"".join(
            each.values + b"\0" * (_padded(len(each.values)) - len(each.values)) for each in shape.primitives
        )
        if block not in offsets:
            offsets[block] = len(blocks)
            blocks += block
        shapes.append(
            {
                "seed": shape.seed,
                "offset": offsets[block],
                "low": [each.low for each in shape.primitives],
                "step": [each.step for each in shape.primitives],
                "member": shape.member,
                "warnings": shape.warnings,
            }
        )
    header = {
        "asset": preview.asset,
        "change": preview.change,
        "reading": preview.reading,
        "draft": preview.draft,
        "primitives": [
            {"mesh": each.mesh, "primitive": each.primitive, "vertices": len(each.values) // 6} for each in first
        ],
        "shapes": shapes,
    }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (_padded(len(text)) - len(text))
    return _HEAD.pack(_MAGIC, _VERSION, len(text)) + text + blocks


def _padded(length: int) -> int:
    return -(-length // 4) * 4
