"""Read the animations of a document, and what they make of nodes and weights at a time.

Source: glTF 2.0 specification, section 3.11 (Animations) and appendix C (Interpolation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.document import Document
from meshdeform.errors import AssetError, ParameterError

Floats = NDArray[np.float64]
_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": None}
_SHOWN = 8
"""How many names an error lists."""


@dataclass(frozen=True)
class NodeTrack:
    """How one property of a node changes."""

    node: int
    path: str  # `translation`, `rotation`, `scale` or `weights`
    times: Floats  # (K,) float64: seconds, ascending
    values: Floats  # (K, C) float64; (K, 3, C) with the tangents of CUBICSPLINE: in-tangent, value, out-tangent
    mode: str  # `LINEAR`, `STEP` or `CUBICSPLINE`

    def at(self, seconds: float) -> Floats:
        """Return the value (C,) at a time; before the first key and after the last one, that of the key."""
        after = int(np.searchsorted(self.times, seconds, "right"))
        keys = self.values[:, 1] if self.mode == "CUBICSPLINE" else self.values
        if after in (0, len(keys)) or self.mode == "STEP":
            return self._as_stored(keys[max(after - 1, 0)])
        start, length = self.times[after - 1], self.times[after] - self.times[after - 1]
        t = float((seconds - start) / length)
        a, b = keys[after - 1], keys[after]
        if self.mode == "CUBICSPLINE":
            leaving, arriving = length * self.values[after - 1, 2], length * self.values[after, 0]
            t2, t3 = t * t, t * t * t
            curve = (2 * t3 - 3 * t2 + 1) * a + (t3 - 2 * t2 + t) * leaving
            return self._as_stored(curve + (3 * t2 - 2 * t3) * b + (t3 - t2) * arriving)
        if self.path == "rotation":
            return _slerp(a, b, t)
        return np.asarray(a + t * (b - a))

    def _as_stored(self, value: Floats) -> Floats:
        return _unit(value) if self.path == "rotation" else value


def _slerp(a: Floats, b: Floats, t: float) -> Floats:
    """Return the rotation at a share of the shorter way from one to another, as quaternions."""
    a, b = _unit(a), _unit(b)
    cosine = float(a @ b)
    b, cosine = (-b, -cosine) if cosine < 0 else (b, cosine)
    angle = np.arccos(min(cosine, 1.0))
    shares = (1 - t, t) if angle < 1e-6 else (np.sin((1 - t) * angle), np.sin(t * angle))
    return _unit(shares[0] * a + shares[1] * b)


def _unit(rotation: Floats) -> Floats:
    """Return a quaternion at unit length; no turn for zero."""
    length = np.linalg.norm(rotation)
    return np.asarray(rotation / length if length > 0 else [0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Clip:
    """One animation of a file."""

    number: int
    name: str
    tracks: tuple[NodeTrack, ...]
    unread: int  # channels that act on anything else than nodes and weights, or are not valid

    @property
    def start(self) -> float:
        """The time of its first key, seconds."""
        return min((float(track.times[0]) for track in self.tracks), default=0.0)

    @property
    def end(self) -> float:
        """The time of its last key, seconds."""
        return max((float(track.times[-1]) for track in self.tracks), default=0.0)


def read_clips(document: Document) -> list[Clip]:
    """Read all animations of a document."""
    animations = document.root.get("animations")
    return [_clip(document, k, each) for k, each in enumerate(animations if isinstance(animations, list) else [])]


def _clip(document: Document, number: int, animation: Any) -> Clip:
    described = animation if isinstance(animation, dict) else {}
    channels, name = described.get("channels"), described.get("name")
    tracks = [_track(document, described, channel) for channel in (channels if isinstance(channels, list) else [])]
    found = tuple(track for track in tracks if track is not None)
    return Clip(number, name if isinstance(name, str) else "", found, len(tracks) - len(found))


def _track(document: Document, animation: Any, channel: Any) -> NodeTrack | None:
    """Return the track of a channel; None if it is not valid, or acts on something else: nothing has checked it."""
    try:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        node, path, mode = target["node"], target["path"], sampler.get("interpolation", "LINEAR")
        times = read_floats(document, sampler["input"])[:, 0].astype(np.float64)
        values = read_floats(document, sampler["output"]).astype(np.float64)
        width_of_path = _WIDTHS[path]
        document.root["nodes"][node].get("mesh")
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, AssetError):
        return None
    per_key = 3 if mode == "CUBICSPLINE" else 1
    if mode not in ("LINEAR", "STEP", "CUBICSPLINE") or not len(times):
        return None
    if values.size % (per_key * len(times)) or not (np.isfinite(times).all() and np.isfinite(values).all()):
        return None
    width = values.size // (per_key * len(times))
    if width != (width_of_path or width) or (np.diff(times) <= 0).any():
        return None
    shape = (len(times), 3, width) if per_key == 3 else (len(times), width)
    return NodeTrack(node, path, times, values.reshape(shape), mode)


def find_clip(clips: Sequence[Clip], wanted: str) -> Clip:
    """Return the clip of a name, or of a number from 0.

    Raises ParameterError: there is no such clip, or several have that name.
    """
    named = [clip for clip in clips if clip.name == wanted]
    if len(named) == 1:
        return named[0]
    if named:
        numbers = ", ".join(str(clip.number) for clip in named)
        raise ParameterError(f"{len(named)} clips are called {wanted!r}.", advice=f"Name one by number: {numbers}.")
    if wanted.isascii() and wanted.isdecimal() and len(wanted) < 10 and int(wanted) < len(clips):
        return clips[int(wanted)]
    if not clips:
        raise ParameterError("The file has no animations.", advice="Leave the pose out: it is that of its nodes.")
    listed = ", ".join(f"{clip.number} {clip.name}".strip() for clip in clips[:_SHOWN])
    more = f" and {len(clips) - _SHOWN} more" if len(clips) > _SHOWN else ""
    raise ParameterError(f"There is no clip {wanted!r}.", advice=f"The clips, by number and name: {listed}{more}.")
