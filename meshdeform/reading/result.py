"""What was found of an asset, and the bytes in which that is kept.

Bytes: the line `meshdeform reading VERSION`, the SHA-256 of the rest, and the rest, compressed by zlib: one line of
JSON, and the labels as int16, little-endian.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.version import VERSION

__all__ = ["GROUND", "NO_PART", "SURE", "UP_TURNS", "Reading"]

GROUND, NO_PART = -1, -2
"""The labels of a plate on which an asset stands, and of faces that are of no known part."""
UP_TURNS: dict[str, Floats] = {"+Y": np.eye(3), "+Z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])}
"""The rotations that turn what points up to +Y: (x, y, z) to (x, z, -y) for +Z."""
SURE, _FRONT_SURE = 0.9, 0.1
"""Probability of the noun, and margin of the front, from which they count as sure."""
_HEAD = f"meshdeform reading {VERSION}\n".encode()
_DIGEST = 32


@dataclass(frozen=True)
class Reading:
    """What an asset was found to be.

    `labels` (F,) int64: the part of each face, an index in `PART_NAMES`, or `GROUND`, or `NO_PART`. `confidence`: the
    probability that each part is right, if the noun and the front are (`trust`). `turn` (3, 3) float64: the rotation
    from the asset's axes to those of its noun, +Y up and +Z the front; `front_margin`: by which share the second
    front's grade is larger, None where the front was given or the noun has none. `probabilities` are those of the nouns
    that came into question, the greatest first; what is missing to 1 is that of something else. `member` is the number
    of the member that fits best, `residual` the mean distance between its surface and the asset's, a share of the
    diagonal. `up`: the axis of the asset that points up, `+Y` or `+Z`.
    """

    noun: str
    probabilities: Mapping[str, float]
    turn: Floats
    front_margin: float | None
    labels: Index
    confidence: Mapping[str, float]
    member: int
    residual: float
    up: str = "+Y"

    @property
    def front_azimuth_deg(self) -> float:
        """Where it faces, from +Z toward +X, -180 to 180; where +Z is up, from -Y toward +X."""
        front = self.turn[2] @ UP_TURNS[self.up].T
        return float(np.degrees(np.arctan2(front[0], front[2]))) + 0.0

    @property
    def probability(self) -> float:
        """The probability of its noun."""
        return self.probabilities[self.noun]

    @property
    def sure(self) -> bool:
        """Whether the noun can be told without a question: it was given, or its probability is at least 0.9."""
        return self.probability >= SURE

    @property
    def front_sure(self) -> bool:
        """Whether the front can be told without a question.

        It was given, the noun has none, or any other front is at least 10 % worse.
        """
        return self.front_margin is None or self.front_margin >= _FRONT_SURE

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of the parts that were found."""
        return tuple(self.confidence)

    def to_bytes(self) -> bytes:
        """Return the reading compressed: about a kilobyte for 10,000 faces."""
        told = {
            "noun": self.noun,
            "probabilities": dict(self.probabilities),
            "turn": self.turn.tolist(),
            "front_margin": self.front_margin,
            "confidence": dict(self.confidence),
            "member": self.member,
            "residual": self.residual,
            "up": self.up,
        }
        body = json.dumps(told).encode() + b"\n" + self.labels.astype("<i2").tobytes()
        packed = zlib.compress(body)
        return _HEAD + hashlib.sha256(packed).digest() + packed

    @classmethod
    def from_bytes(cls, data: bytes) -> Reading:
        """Return the reading that `to_bytes` has written.

        Raises
        ------
        ValueError
            The bytes are damaged, or another version has made them: read the asset again.
        """
        if not data.startswith(_HEAD):
            raise ValueError("these are not the bytes of a reading of this version: read the asset again")
        packed = data[len(_HEAD) + _DIGEST :]
        if hashlib.sha256(packed).digest() != data[len(_HEAD) : len(_HEAD) + _DIGEST]:
            raise ValueError("the bytes of the reading are damaged: read the asset again")
        line, _, labels = zlib.decompress(packed).partition(b"\n")
        told = json.loads(line)
        told["turn"] = np.array(told["turn"], np.float64)
        return cls(**told, labels=np.frombuffer(labels, "<i2").astype(np.int64))
