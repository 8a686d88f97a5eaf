"""Collect what the file of a body says of its parts, and read a body of which the noun may be known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from meshdeform.nouns.deformed import Part
from meshdeform.plain.body import Body
from meshdeform.plain.joints import JointParts
from meshdeform.reading import FITTED, Evidence, Reading, read_asset
from meshdeform.reading.evidence import JOINT_PARTS


def evidence_of(body: Body) -> Evidence:
    """Return what joints and names say of the vertices of a body."""
    joints = JointParts(body)
    shares = {name: joints.of_class(name) for name in JOINT_PARTS} if joints.rigged else {}
    return Evidence({name: share for name, share in shares.items() if share is not None}, body.names)


def read_body(
    body: Body,
    nouns: Mapping[str, float],
    front_azimuth_deg: float | None = None,
    cache: Path | None = None,
    *,
    z_up: Mapping[str, float] | None = None,
    z_share: float = 0.2,
    fitted: int = FITTED,
) -> Reading:
    """Read a body that may be one of several nouns, with their probabilities (`reading.read_asset`).

    `front_azimuth_deg`: where it faces, from +Z toward +X, if that is known; `cache`: a folder for samples of nouns;
    `z_up`: what it may be if +Z is up, where that is open, and `z_share` of how many files it is; `fitted`: how
    many members are fitted. Raises ValueError: it has no area.
    """
    return read_asset(
        Part(body.points, body.faces),
        nouns,
        z_up=z_up,
        z_share=z_share,
        evidence=evidence_of(body),
        front_azimuth_deg=front_azimuth_deg,
        cache=cache,
        fitted=fitted,
    )
